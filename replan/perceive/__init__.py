"""Perception alone on recorded frames: files, pictures and a page."""
