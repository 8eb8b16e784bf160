"""Many simulations of the twin together, and what residuals read of them. May import `path_planning` and below."""
