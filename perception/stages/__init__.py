"""Stages of one look, each with its policy: known shapes first, boxes, masks, solids, agreement of cameras."""
