"""Report of a diagnosis: text and traces, then the figures, then the page that combines them."""
