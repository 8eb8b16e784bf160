"""RIHS01, ROS 2's hash of a message type: two sides with the same hash have the same fields in the same order.

Source: REP 2011 and 2016, and rosidl_generator_type_description: the SHA-256 of the type's description as JSON,
with the descriptions of all types in it by name. Defaults, constants and comments do not count.
"""

import hashlib
import json
import re
from functools import cache
from typing import Any

from perception.ros2.cdr import fields

# Numbers of type_description_interfaces/msg/FieldType.
PRIMITIVES = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
NESTED, ARRAY, SEQUENCE = 1, 48, 144  # a nested type; what is added for an array of fixed and of any length


@cache
def type_hash(kind: str) -> str:
    """The hash of a type of `perception.ros2.cdr.DEFINITIONS`, as "RIHS01_" and 64 hexadecimal digits.

    Args:
        kind: For instance "sensor_msgs/msg/JointState".
    """
    inside: list[str] = []
    _collect(kind, inside)
    description = {
        "type_description": _describe(kind),
        "referenced_type_descriptions": [_describe(name) for name in sorted(inside)],
    }
    text = json.dumps(description, separators=(", ", ": "))
    return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"


def _split(text: str) -> tuple[str, int, int]:
    """Of a field's type: what it holds, what its form adds to the type's number, its length if fixed, else 0."""
    found = re.fullmatch(r"([\w/]+)(?:\[(\d*)\])?", text)
    assert found is not None, text
    base, length = found.groups()
    base = base if base in PRIMITIVES else base.replace("/", "/msg/")
    if length is None:
        return base, 0, 0
    return base, (ARRAY if length else SEQUENCE), int(length or 0)


def _describe(kind: str) -> dict[str, Any]:
    described = []
    for text, name in fields(kind):
        base, form, length = _split(text)
        described.append(
            {
                "name": name,
                "type": {
                    "type_id": PRIMITIVES.get(base, NESTED) + form,
                    "capacity": length,
                    "string_capacity": 0,
                    "nested_type_name": "" if base in PRIMITIVES else base,
                },
            }
        )
    return {"type_name": kind, "fields": described}


def _collect(kind: str, found: list[str]) -> None:
    for text, _ in fields(kind):
        base, _, _ = _split(text)
        if base not in PRIMITIVES and base not in found:
            found.append(base)
            _collect(base, found)
