"""Cell files: what they may say, checked strictly; the built-in ones lie in `builtin/`. Imports no other room."""
