"""Who may do what over a link between machines: mutual TLS, and rights by the role in a certificate's common name.

A link file (YAML) says which certificates a process uses; `replan security init` writes one for each role:

    role: operator
    ca: ca.pem                  # the authority that signed everybody's certificate
    certificate: operator.pem   # its common name is the role
    key: operator-key.pem

Paths count from the file's own folder. The session that listens (robot process or router) enforces the rights; what
a client believes about itself changes nothing.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from control.errors import ConfigError
from control.strict_yaml import read_mapping

Role = Literal["robot", "router", "camera", "operator", "viewer", "ros2"]
ROLES: tuple[Role, ...] = get_args(Role)
LISTENING_ROLES: tuple[Role, ...] = ("robot", "router")  # only their certificates may serve


@dataclass(frozen=True)
class LinkSecurity:
    """The certificates that a process shows and trusts.

    Attributes:
        role: What this process is; the common name of its certificate.
        ca: Certificate of the authority (PEM).
        certificate, key: This process's certificate and its private key (PEM).
    """

    role: Role
    ca: Path
    certificate: Path
    key: Path

    def __post_init__(self) -> None:
        for name in ("ca", "certificate", "key"):
            path: Path = getattr(self, name)
            if not path.is_file():
                raise ConfigError(
                    f"link: there is no file '{path}' ({name}); `replan security init FOLDER` makes all of them"
                )

    def tls_settings(self) -> dict[str, Any]:
        """Settings of the transport by path: both sides show a certificate, and the server's name is checked."""
        tls = "transport/link/tls"
        return {
            f"{tls}/root_ca_certificate": str(self.ca),
            f"{tls}/enable_mtls": True,
            f"{tls}/verify_name_on_connect": True,
            f"{tls}/listen_certificate": str(self.certificate),
            f"{tls}/listen_private_key": str(self.key),
            f"{tls}/connect_certificate": str(self.certificate),
            f"{tls}/connect_private_key": str(self.key),
        }


class _LinkFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    role: Role
    ca: Path
    certificate: Path
    key: Path


def read_link_file(path: Path) -> LinkSecurity:
    """The certificates that a link file names.

    Raises:
        ConfigError: It cannot be read, has unknown or missing keys, or names a file that is not there.
    """
    content = read_mapping(path, "a link file", _LinkFile.model_fields)
    try:
        link = _LinkFile.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"{path}: key '{where}': {first['msg']}; a link file has the keys {', '.join(_LinkFile.model_fields)}"
        ) from None
    folder = path.absolute().parent
    return LinkSecurity(link.role, folder / link.ca, folder / link.certificate, folder / link.key)


def link_or_none(path: Path | None) -> LinkSecurity | None:
    """As `read_link_file`; None stands for a link within this machine, which needs no certificates."""
    return None if path is None else read_link_file(path)


def link_of(robot: str | None, path: Path | None) -> LinkSecurity | None:
    """The link file of a command that connects to `robot`; it starts a simulated cell here when that is None.

    Raises:
        ConfigError: As `read_link_file`; or a link file although no robot was named.
    """
    if path is not None and robot is None:
        raise ConfigError(f"a link file ({path}) is for a robot on another machine: give --robot tls/HOST:PORT as well")
    return link_or_none(path)


def as_yaml(security: LinkSecurity) -> str:
    """The text of a link file that stands in the folder of its certificates."""
    named = dataclasses.asdict(security)
    return "".join(f"{key}: {named[key] if key == 'role' else named[key].name}\n" for key in _LinkFile.model_fields)
