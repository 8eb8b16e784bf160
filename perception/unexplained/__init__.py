"""Depth that nothing known explains: what explains depth, clusters of the rest, hulls around them."""
