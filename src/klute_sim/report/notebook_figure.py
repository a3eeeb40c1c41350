"""Figure that a notebook shows as a picture, as the last value of a cell or through ``display``."""

import io

from matplotlib.figure import Figure

NOTEBOOK_DPI = 130
"""Resolution in a notebook [dots per inch]: sharp at the width of a page."""


class NotebookFigure(Figure):
    """Matplotlib figure with a picture for notebooks, which draw other figures only if pyplot made them."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, dpi=NOTEBOOK_DPI, format="png")
        return buffer.getvalue()
