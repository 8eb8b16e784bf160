"""PNG and JPEG bytes into arrays; what is cut off is refused instead of being filled with grey. Needs OpenCV."""

import cv2
import numpy as np

from perception.errors import FrameError

JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
PNG_START, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
TAIL = 4096  # bytes; cameras may pad behind the end of a picture


def decode_picture(data: bytes, flag: int, what: str) -> np.ndarray:
    """A picture as OpenCV decodes it (colour as blue, green, red).

    Args:
        data: All bytes of the picture.
        flag: One of OpenCV's IMREAD flags.
        what: Which picture, for the message.

    Raises:
        FrameError: The bytes are no picture, or end before the picture does.
    """
    for start, end in ((JPEG_START, JPEG_END), (PNG_START, PNG_END)):
        if data.startswith(start) and end not in data[-TAIL:]:
            raise FrameError(f"{what} cannot be read as a picture: it is cut off after {len(data)} bytes")
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), flag) if data else None
    except cv2.error as error:
        raise FrameError(f"{what} cannot be read as a picture: {' '.join(str(error).split())[:120]}") from error
    if picture is None:
        raise FrameError(f"{what} cannot be read as a picture")
    return picture
