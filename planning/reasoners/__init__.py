"""Whatever answers prompts: servers, local weights, cassettes, noise, and the one policy of asking."""
