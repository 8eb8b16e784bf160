"""Which version of the wire's protocol each release speaks: what two machines have to agree on."""

from types import MappingProxyType

from replan_base import __version__

# Every protocol that messages had, and the release that spoke it. 1 and 2 were given up while 0.1.0 was made.
RELEASES = MappingProxyType({1: "0.1.0", 2: "0.1.0", 3: "0.1.0", 4: "0.2.0"})


def other_protocol(theirs: object, ours: int) -> str:
    """What to say of a message in another version of the protocol.

    Args:
        theirs: Version that the message names; may be anything.
        ours: Version that this side speaks.
    """
    release = RELEASES.get(theirs) if type(theirs) is int else None
    spoken = f" (replan {release} speaks it)" if release is not None else ""
    return (
        f"version {theirs!r} is not understood{spoken}; this side, replan {__version__}, speaks version {ours}: "
        "install the same release on both sides"
    )
