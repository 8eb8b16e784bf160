"""The RePlan loop: planners, perceiver, verifier, reasoner backends and replanning memory."""
