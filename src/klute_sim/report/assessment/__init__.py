"""Report of an assessment: figure and page."""
