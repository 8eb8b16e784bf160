"""Goals, names, facts, descriptions, reward programs: text in strict forms, and its parsers. Imports no other room."""
