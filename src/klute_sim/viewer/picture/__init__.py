"""Pictures of recordings without a screen: ``rrd_reader``, then ``render`` and ``render_scene``, then ``picture``."""
