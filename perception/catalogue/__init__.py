"""What things are called and what they look like: nouns, synonyms, colours. Imports frames and estimates only."""
