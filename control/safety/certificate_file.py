"""Certificates as files: JSON that a person can read, that another program can check, and that changes nothing.

    {"format": "replan-certificate", "version": 1, "serial": "...", "trajectory_hash": "...", "profile": "...",
     "firmware": "...", "scene_stamp": s, "limits_hash": "...", "issued": s, "expires": s}

The fields are those of `control.safety.certificate.Certificate`; times come back bit for bit. Needs neither the twin
nor the robot's model: a robot-side process reads and verifies on its own.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from control.errors import ConfigError
from control.safety.certificate import Certificate

MOST_BYTES = 64 * 1024  # a certificate has less than one kibibyte

Name = Annotated[str, Field(min_length=1, max_length=64)]


class _Document(BaseModel):
    """What stands in the file; unknown fields, wrong types and numbers that are not finite are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
    format: Literal["replan-certificate"] = "replan-certificate"
    version: Literal[1] = 1
    serial: Name
    trajectory_hash: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    profile: Name
    firmware: Name
    scene_stamp: float
    limits_hash: Name
    issued: float
    expires: float


def write_certificate(path: Path, certificate: Certificate) -> None:
    """Write a certificate.

    Args:
        path: File to write; replaced when it exists.
        certificate: What to write.

    Raises:
        ConfigError: The file cannot be written, or the certificate has a field that no file may have.
    """
    try:
        document = _Document(**asdict(certificate))
    except ValidationError as error:
        raise ConfigError(f"this certificate cannot be written: {_first(error)}") from error
    try:
        path.write_text(document.model_dump_json(indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the certificate '{path}': {error.strerror or error}") from error


def read_certificate(path: Path) -> Certificate:
    """Read a certificate; whether it is good is for `certification.verify_certificate` to say.

    Raises:
        ConfigError: No such file, or not a certificate; names the file and the field at fault.
    """
    try:
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise ConfigError(
                f"'{path}' is no certificate: it has {size} bytes, a certificate has at most {MOST_BYTES}"
            )
        text = path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"cannot read the certificate '{path}': {error.strerror or error}; give the JSON file that came with the "
            "verdict"
        ) from error
    try:
        document = _Document.model_validate_json(text)
        # What a certificate is must be said, not assumed.
        missing = {"format", "version"} - document.model_fields_set
    except ValidationError as error:
        raise ConfigError(f"'{path}' is no certificate: {_first(error)}") from error
    if missing:
        raise ConfigError(f"'{path}' is no certificate: field '{min(missing)}': Field required")
    return Certificate(**document.model_dump(exclude={"format", "version"}))


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    return f"field '{where}': {first['msg']}" if where else f"it is not a JSON object of its fields ({first['msg']})"
