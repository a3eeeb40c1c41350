"""Effects that the dissertation's model leaves out: each with a name, and none of them there unless asked for."""
