"""Stages of one look, each with its policy: models, shapes first, boxes, masks, solids, cameras. Imports no scoring."""
