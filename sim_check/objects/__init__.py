"""The object library: geometry, mass and friction of what nouns name. Imports no other room."""
