"""Depth to solids: cleaning, clouds, the support, first fits, refinement, spreads. May import `catalogue`."""
