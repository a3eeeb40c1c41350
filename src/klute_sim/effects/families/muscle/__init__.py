"""Built-in effects of the McKibben muscle: bladder, braid, ends, friction and damping.

The modules do not depend on each other.
"""
