"""Report of a comparison: text, then table and figures, then the page that combines them."""
