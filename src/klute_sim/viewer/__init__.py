"""Every folder in the rerun viewer: a recording, a layout made for it, and pictures of both without a screen."""
