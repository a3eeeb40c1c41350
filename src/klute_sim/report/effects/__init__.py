"""Description of effects: text, and figures of their signatures."""
