"""Recorded RGB-D frames of every format, one reader behind all. May import `ros2` and `geometry`."""
