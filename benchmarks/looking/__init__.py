"""Perception: boxes, masks, poses, times."""
