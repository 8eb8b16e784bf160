"""Which estimates are of one thing: over cameras, over frames, of one name. Imports estimates only."""
