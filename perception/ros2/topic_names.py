"""Names of topics; needs no other package."""

import re


def topic_name(camera: str) -> str:
    """A camera's name as part of a topic: letters, digits and underscores."""
    name = re.sub(r"\W", "_", camera, flags=re.ASCII)
    return name if name[:1].isalpha() else f"camera_{name}"
