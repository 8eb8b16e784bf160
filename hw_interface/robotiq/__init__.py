"""A Robotiq 2F-85 over Modbus, on a serial line or through a gateway."""
