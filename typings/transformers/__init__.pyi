"""Stands in for transformers while types are checked: its own index of models takes the checker a minute to read.

Nothing is lost: the classes that we use are chosen by name at run time, so their types are not known anyway.
"""

from typing import Any

def __getattr__(name: str) -> Any: ...
