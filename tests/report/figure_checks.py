"""Checks that hold for every figure of a report."""

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

PAGE_WIDTH_PIXELS, MIN_TYPE_PIXELS = 1000.0, 10.0
"""Width of a page, and the smallest type that is legible on it."""
POINTS_PER_INCH = 72.0
TOLERANCE_PIXELS = 3.0


def check_figure(figure: Figure) -> None:
    """Assert that the type is legible at the width of a page, inside the figure, and that no legend lies on a panel."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer, width = canvas.get_renderer(), figure.get_size_inches()[0]
    for text in figure.findobj(Text):
        if not isinstance(text, Text) or not text.get_visible() or not text.get_text().strip():
            continue
        size = text.get_fontsize() / POINTS_PER_INCH * PAGE_WIDTH_PIXELS / max(width, PAGE_WIDTH_PIXELS / 130.0)
        assert size >= MIN_TYPE_PIXELS, f"'{text.get_text()}' is {size:.1f} pixels high at the width of a page"
    for text in [text for axis in figure.axes for text in (axis.title, axis.xaxis.label, axis.yaxis.label)]:
        if text.get_text() and text.get_visible():
            box = text.get_window_extent(renderer)
            assert box.x0 >= -TOLERANCE_PIXELS, text.get_text()
            assert box.x1 <= figure.bbox.x1 + TOLERANCE_PIXELS, text.get_text()
    titles = [axis.title for axis in figure.axes if axis.title.get_text()]
    boxes = [title.get_window_extent(renderer) for title in titles]
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[k + 1 :]), titles[k].get_text()
    panels = [axis.get_window_extent(renderer) for axis in figure.axes if axis.axison]
    legends = [*figure.legends, *(axis.get_legend() for axis in figure.axes)]
    for legend in filter(None, legends):
        box = legend.get_window_extent(renderer)
        for panel in panels:
            is_apart = box.y0 >= panel.y1 - TOLERANCE_PIXELS or box.y1 <= panel.y0 + TOLERANCE_PIXELS
            is_apart |= box.x0 >= panel.x1 or box.x1 <= panel.x0
            assert is_apart, f"the legend {[text.get_text() for text in legend.get_texts()]} lies on a panel"
