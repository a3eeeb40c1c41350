"""Report of the comparison with the dissertation: figures and page."""
