"""Making and examining the keys and certificates of links between machines (X.509, elliptic curve P-256)."""

import datetime
import ipaddress
import os
from dataclasses import dataclass
from pathlib import Path

from control.errors import ConfigError, MachineError
from hw_interface.link.security import LISTENING_ROLES, ROLES, LinkSecurity, Role, as_yaml
from replan_base.parts import install_part

CA_FILE, CA_KEY_FILE = "ca.pem", "ca-key.pem"
CLOCK_SLACK = datetime.timedelta(hours=1)  # certificates hold from a little before now: clocks differ
SOON = datetime.timedelta(days=30)


@dataclass(frozen=True)
class KnownCertificate:
    """One certificate, examined.

    Attributes:
        path: Its file.
        name: Its common name: the role, or the authority.
        hosts: Names and addresses that it may serve under; empty for those that only connect.
        begins, expires: When it holds (UTC).
        trouble: What is wrong with it in words, empty when nothing is.
    """

    path: Path
    name: str
    hosts: tuple[str, ...]
    begins: datetime.datetime
    expires: datetime.datetime
    trouble: str


def _require_cryptography() -> None:
    try:
        import cryptography  # noqa: F401
    except ImportError:
        raise MachineError(f"the package cryptography is not installed; run: {install_part('security')}") from None


def make_keys(folder: Path, hosts: tuple[str, ...], days: int, now: datetime.datetime) -> tuple[Path, ...]:
    """An authority, and for every role a key, a certificate and a link file.

    Args:
        folder: Where to put them; made if need be.
        hosts: Names and IP addresses under which the robot's or the router's machine is reached.
        days: How long the certificates hold.
        now: The time (UTC).

    Returns:
        The link files, one a role.

    Raises:
        ConfigError: No host, a `days` that is not positive, or the folder holds keys already.
        MachineError: The folder cannot be written, or the package cryptography is not installed.
    """
    _require_cryptography()
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID

    if not hosts:
        raise ConfigError("give at least one --host: a name or address under which other machines reach the robot")
    if days <= 0:
        raise ConfigError(f"certificates cannot hold for {days} days; give 1 or more")
    names = [n for role in ROLES for n in (f"{role}.pem", f"{role}-key.pem", f"{role}.yaml")]
    present = [n for n in (CA_FILE, CA_KEY_FILE, *names) if (folder / n).exists()]
    if present:
        raise ConfigError(
            f"{folder} holds {present[0]} already; keys are never overwritten: choose another folder, or move the old "
            "keys away (every machine then needs the new ones)"
        )
    alternative = [_general_name(host) for host in hosts]
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        ca_key = ec.generate_private_key(ec.SECP256R1())
        # Two authorities of one name could not be told apart when a certificate is refused.
        ca_name = _name(f"replan link authority {os.urandom(4).hex()}")
        authority = _builder(ca_name, ca_name, ca_key.public_key(), days, now)
        authority = authority.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        authority = authority.add_extension(_usage(signs=True), critical=True)
        ca = authority.sign(ca_key, hashes.SHA256())
        _write_key(folder / CA_KEY_FILE, ca_key)
        _write_certificate(folder / CA_FILE, ca)
        links = []
        for role in ROLES:
            key = ec.generate_private_key(ec.SECP256R1())
            builder = _builder(_name(role), ca_name, key.public_key(), days, now)
            builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            builder = builder.add_extension(_usage(signs=False), critical=True)
            uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
            if role in LISTENING_ROLES:
                # A viewer's or camera's certificate cannot pose as the robot: it may not serve.
                uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
                builder = builder.add_extension(x509.SubjectAlternativeName(alternative), critical=False)
            builder = builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            _write_key(folder / f"{role}-key.pem", key)
            _write_certificate(folder / f"{role}.pem", builder.sign(ca_key, hashes.SHA256()))
            links.append(_write_link(folder, role))
    except OSError as error:
        raise MachineError(f"cannot write keys into {folder}: {error.strerror}") from error
    return tuple(links)


def examine_keys(security: LinkSecurity, now: datetime.datetime) -> tuple[KnownCertificate, ...]:
    """The certificates of a link file: the authority's and the process's own, each with what is wrong with it.

    Raises:
        ConfigError: A file that is no certificate or key.
        MachineError: The package cryptography is not installed.
    """
    _require_cryptography()
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    ca, own = _load(security.ca), _load(security.certificate)
    troubles = []
    if _common_name(own) != security.role:
        troubles.append(f"is for the role '{_common_name(own)}'; the link file says '{security.role}'")
    try:
        own.verify_directly_issued_by(ca)
    except (ValueError, TypeError, InvalidSignature):
        troubles.append(f"was not signed by {security.ca}")
    try:
        key = load_pem_private_key(security.key.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(f"{security.key}: is no private key in PEM without a password ({error})") from None
    if key.public_key() != own.public_key():
        troubles.append(f"does not belong to the key {security.key}")
    if security.key.stat().st_mode & 0o077:
        troubles.append(f"its key {security.key} can be read by others; run: chmod 600 {security.key}")
    found = []
    for path, certificate, more in ((security.ca, ca, []), (security.certificate, own, troubles)):
        try:
            names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
            hosts = tuple(str(n.value) for n in names)
        except x509.ExtensionNotFound:
            hosts = ()
        begins, expires = certificate.not_valid_before_utc, certificate.not_valid_after_utc
        trouble = "; ".join([*more, *_age(begins, expires, now)])
        found.append(KnownCertificate(path, _common_name(certificate), hosts, begins, expires, trouble))
    return tuple(found)


def _age(begins: datetime.datetime, expires: datetime.datetime, now: datetime.datetime) -> list[str]:
    if now >= expires:
        return [f"expired on {expires:%Y-%m-%d}; make new keys with `replan security init`"]
    if now < begins:
        return [f"holds only from {begins:%Y-%m-%d %H:%M} UTC on; set this machine's clock"]
    if expires - now < SOON:
        return [f"expires on {expires:%Y-%m-%d}, in {(expires - now).days} days; make new keys in time"]
    return []


def _general_name(host: str):
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(host.strip("[]")))
    except ValueError:
        pass
    if not host or len(host) > 253 or any(not (c.isascii() and (c.isalnum() or c in "-.")) for c in host):
        raise ConfigError(f"'{host}' is neither a host name nor an IP address; write for instance robot-pc or 10.0.0.2")
    return x509.DNSName(host)


def _name(common: str):
    from cryptography import x509

    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common)])


def _common_name(certificate) -> str:
    from cryptography import x509

    names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def _usage(signs: bool):
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _builder(subject, issuer, public_key, days: int, now: datetime.datetime):
    from cryptography import x509

    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SLACK)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _write_key(path: Path, key) -> None:
    from cryptography.hazmat.primitives import serialization

    data = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    # Born with its rights, so that nobody can read it in between; never opened when it exists.
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)


def _write_certificate(path: Path, certificate) -> None:
    from cryptography.hazmat.primitives import serialization

    path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def _write_link(folder: Path, role: Role) -> Path:
    path = folder / f"{role}.yaml"
    path.write_text(as_yaml(LinkSecurity(role, folder / CA_FILE, folder / f"{role}.pem", folder / f"{role}-key.pem")))
    return path


def _load(path: Path):
    from cryptography import x509

    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: is no certificate in PEM ({error})") from None
