"""One module per reward term, a base class for them, and the explicit list of those that exist. Needs numpy only."""
