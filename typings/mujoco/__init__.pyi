# MuJoCo's functions and structures come from binary modules that carry no types: to the type checker all are Any.
# Without this file every one of them is an unknown attribute, and the rule that finds unknown attributes of our own
# modules would have to be switched off.
from typing import Any

def __getattr__(name: str) -> Any: ...
