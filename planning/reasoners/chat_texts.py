"""What chat models are sent and what they send back, whichever way they are run: roles, pictures, thinking aloud."""

import base64
import re
from collections.abc import Sequence

import numpy as np

from prompts.contracts import contract
from prompts.roles import ROLE_TEXTS

_THINKING = re.compile(r"\A\s*<think>.*?</think>\s*", re.DOTALL)


def role_text(name: str) -> str:
    """The system text for a contract: what the one who answers it is."""
    return ROLE_TEXTS[contract(name).role]


def without_thinking(text: str) -> str:
    """An answer without the block in which some models think aloud before it."""
    return _THINKING.sub("", text)


def shrink(picture: np.ndarray, longest: int) -> np.ndarray:
    """A picture whose longer edge has at most `longest` pixels.

    Args:
        picture: RGB, uint8, shape (height, width, 3).
        longest: In pixels.

    Returns:
        The same picture when it is small enough, else a smaller one of the same proportions.
    """
    import cv2

    height, width = picture.shape[:2]
    scale = longest / max(height, width)
    if scale >= 1.0:
        return picture
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def as_data_url(picture: np.ndarray, longest: int) -> str:
    """A picture as a PNG data URL.

    Args:
        picture: RGB, uint8, shape (height, width, 3).
        longest: At most so many pixels of its longer edge are sent.
    """
    import cv2

    ok, png = cv2.imencode(".png", cv2.cvtColor(shrink(picture, longest), cv2.COLOR_RGB2BGR))
    if not ok:
        raise ValueError(f"a picture of shape {picture.shape} and type {picture.dtype} cannot be written as PNG")
    return "data:image/png;base64," + base64.b64encode(png.tobytes()).decode("ascii")


def chat_messages(name: str, prompt: str, pictures: Sequence[object]) -> list[dict]:
    """System and user message in the shape that chat servers and chat templates share.

    Args:
        name: Of the contract.
        prompt: The question.
        pictures: Parts that hold a picture each, in whatever form the receiver takes them.
    """
    content = [{"type": "text", "text": prompt}, *pictures] if pictures else prompt
    return [{"role": "system", "content": role_text(name)}, {"role": "user", "content": content}]
