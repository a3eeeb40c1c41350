"""From a motion laboratory's files to strides: names, conventions, filters, events, and what cannot be trusted."""
