"""Stages of one look, each with its policy: shapes first, boxes, masks, solids, cameras. May import all but scoring."""
