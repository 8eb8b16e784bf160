"""Why a link does not come about, in words: the transport itself only says that it timed out."""

import select
import socket
import ssl

from hw_interface.link.security import LinkSecurity

_PATIENCE = 1.0  # [s] for the other side's objection after the handshake; it comes at once or not at all


def why_no_link(protocol: str, host: str, port: int, security: LinkSecurity | None, timeout: float) -> str:
    """What goes wrong when this process connects there; empty when nothing can be told.

    Args:
        protocol: "tcp" or "tls".
        timeout: Longest wait for the connection in [s].
    """
    try:
        with socket.create_connection((host.strip("[]"), port), timeout) as link:
            if protocol == "tcp":
                return _why_plain(link)
            assert security is not None
            return _why_tls(link, host.strip("[]"), security)
    except (TimeoutError, ConnectionRefusedError):
        return ""  # nobody there
    except OSError as error:
        return f"{host}: {error.strerror or error}"


def _why_plain(link: socket.socket) -> str:
    # A server with TLS answers anything that is no handshake with an alert (record type 21), or hangs up.
    link.sendall(b"\0" * 16)
    link.settimeout(_PATIENCE)
    try:
        answer = link.recv(1)
    except (TimeoutError, ConnectionResetError):
        return ""
    return "it speaks TLS only: write tls/HOST:PORT and give a link file (--link FILE)" if answer == b"\x15" else ""


def _why_tls(link: socket.socket, host: str, security: LinkSecurity) -> str:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(security.ca)
        context.load_cert_chain(security.certificate, security.key)
    except (ssl.SSLError, OSError) as error:
        return f"the files of the link file are not usable ({error.strerror or error})"
    try:
        with context.wrap_socket(link, server_hostname=host) as secured:
            # In TLS 1.3 the server's opinion of our certificate comes after the handshake.
            secured.settimeout(_PATIENCE)
            if select.select([secured], [], [], _PATIENCE)[0]:
                secured.recv(1)
            return ""
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is not accepted here: {error.verify_message} (trusted here: {security.ca})"
    except ssl.SSLError as error:
        reason = (error.reason or str(error)).lower()
        if "alert" in reason:
            return (
                f"it does not accept our certificate {security.certificate} "
                f"({reason.replace('_', ' ').rpartition('alert ')[2]}); `replan security show` examines it"
            )
        return (
            "it does not speak TLS: plain tcp/ on this machine, or another program" if "version" in reason else reason
        )
    except (TimeoutError, OSError):
        return "it does not answer a TLS handshake: plain tcp/ on this machine, or another program"
