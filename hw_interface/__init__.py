"""Messages, transport, driver and nodes between the stack and a robot cell, simulated or real."""
