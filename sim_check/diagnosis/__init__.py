"""Why no motion was found, or why a joint does not move, by taking bodies away in the twin. May import `twin`."""
