"""The embedded reasoner: rules over words and perceived objects, not a language model. May import `language`."""
