"""Robots without hardware behind the same messages: perfect joints, and physics. May import `cell`."""
