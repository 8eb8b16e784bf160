"""Things whose shape is known beforehand: articulated furniture and forms, by rays. May import `geometry`."""
