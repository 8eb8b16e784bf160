"""Certificates for tests that `replan security init` would never make."""

import dataclasses
import datetime
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

from hw_interface.link.security import LinkSecurity, Role, read_link_file


def link(folder: Path, role: Role) -> LinkSecurity:
    """The link of a role whose files are in the folder."""
    return read_link_file(folder / f"{role}.yaml")


def lasting_from_to(security: LinkSecurity, begins: datetime.datetime, expires: datetime.datetime) -> LinkSecurity:
    """The same link with a certificate that the same authority signed for another time."""
    key = serialization.load_pem_private_key((security.ca.parent / "ca-key.pem").read_bytes(), None)
    assert isinstance(key, EllipticCurvePrivateKey)
    known = x509.load_pem_x509_certificate(security.certificate.read_bytes())
    builder = x509.CertificateBuilder(
        known.issuer, known.subject, known.public_key(), x509.random_serial_number(), begins, expires
    )
    for extension in known.extensions:
        builder = builder.add_extension(extension.value, extension.critical)
    path = security.certificate.with_name(f"{security.role}-{begins:%Y%m%d}.pem")
    path.write_bytes(builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM))
    return dataclasses.replace(security, certificate=path)
