#!/usr/bin/env bash
# pymodbus puts the first of 16 bits into the upper byte of a register, and returns lists of one value without the
#   list.
#
# Version: pymodbus 3.16.1, Python 3.11.
# Expected: the first of a list of bits is bit 0 of the register, value 1, as Modbus sends the lowest bit of coils
#   first; the number of values does not change the type of the answer.
# Behaviour: the first bit is bit 8, value 256; bits 0 to 7 are the second half of the list. Two registers give a list
#   of two numbers, one register gives a bare number.
# Output:
#   first bit set: register 256
#   ninth bit set: register 1
#   two registers: [7, 8]
#   one register: 7
# Remedy: registers of a gripper are packed with shifts of plain numbers; a list is made where the count may be one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pymodbus==3.16.1
"$folder/venv/bin/python" - <<'PYTHON'
from pymodbus.client.mixin import ModbusClientMixin

kinds = ModbusClientMixin.DATATYPE


def register(bit):
    """The register that is made of 16 bits, one of which is set."""
    (value,) = ModbusClientMixin.convert_to_registers([i == bit for i in range(16)], kinds.BITS)
    return value


seen = {
    "first bit set: register": register(0),
    "ninth bit set: register": register(8),
    "two registers:": ModbusClientMixin.convert_from_registers([7, 8], kinds.UINT16),
    "one register:": ModbusClientMixin.convert_from_registers([7], kinds.UINT16),
}
for name, what in seen.items():
    print(name, what)
raise SystemExit(0 if list(seen.values()) == [256, 1, [7, 8], 7] else "the behaviour has changed")
PYTHON
