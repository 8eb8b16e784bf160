"""Pages that reports are: one self-contained HTML file each, made of a template and its content."""

import base64
import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from control.errors import ConfigError
from replan_base import __version__

JPEG_QUALITY = 85


def write_page(template: str, content: Mapping[str, Any], path: Path) -> None:
    """Write a page.

    Args:
        template: File name in the folder templates/.
        content: Everything that the template names.
        path: Where to; its folder is made when absent.

    Raises:
        ConfigError: The file cannot be written.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    html = environment.get_template(template).render(**content)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(html, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the report {path}: {error.strerror}; choose another place") from error


def jpeg_text(picture: np.ndarray, quality: int = JPEG_QUALITY) -> str:
    """An RGB picture, uint8, shape (height, width, 3), as JPEG in base64 text."""
    import cv2

    ok, data = cv2.imencode(".jpg", picture[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert ok
    return base64.b64encode(data.tobytes()).decode("ascii")


def made_by(*parts: str) -> str:
    """The last line of a page: this program's version, further parts, and now."""
    now = datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S %Z")
    return ", ".join([f"replan {__version__}", *parts, now])
