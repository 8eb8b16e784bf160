"""The Panda's control box simulated: the research interface, version 5, as the unmodified libfranka speaks it."""
