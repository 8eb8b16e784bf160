"""The driver, the control box and the transport, under faults and at pace."""
