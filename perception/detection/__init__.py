"""Boxes and masks: detectors, segmenters, where their weights lie. May import `geometry` and `catalogue`."""
