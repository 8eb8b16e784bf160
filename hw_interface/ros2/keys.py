"""Names that ROS 2's two ways over zenoh know a topic by, and what they need to be told beside its messages.

zenoh-bridge-ros2dds (any ROS 2 with DDS): a topic's key is its name; the token

    @/<session>/@ros2_lv/MP/<key>/<type>/<keyless>:<reliability>:<durability>:<history>,<depth>

with § for each slash of key and type has the bridge announce it. Source: zenoh-plugin-ros2dds, liveliness_mgt.rs.

rmw_zenoh (ROS 2 on zenoh itself): the key is <domain>/<topic>/<DDS type>/<type hash>, every message carries its number,
time and sender, and the tokens

    @ros2_lv/<domain>/<session>/<node>/<node>/NN/%/<namespace>/<name>
    @ros2_lv/<domain>/<session>/<node>/<entity>/MP/%/<namespace>/<name>/<topic>/<DDS type>/<hash>/<quality of service>

with % for each slash tell of node and publisher; what of the quality of service is the default stays empty. Source:
rmw_zenoh, docs/design.md, liveliness_utils.cpp and attachment_helpers.cpp.
"""

import time
from dataclasses import dataclass
from typing import Protocol

from perception.ros2.messages import type_hash

NODE_NAME = "replan"
DEPTH = 10  # messages that a reader keeps by default
BRIDGE_SLASH, RMW_SLASH = "§", "%"


class Naming(Protocol):
    """How topics are named on the wire."""

    def key(self, topic: str, kind: str) -> str:
        """Key that a topic's messages are put to."""
        ...

    def token(self, topic: str, kind: str, session: str, entity: int, latched: bool) -> str:
        """Liveliness token of its publisher.

        Args:
            topic, kind: As in `Ros2Message`.
            session: Id of the zenoh session.
            entity: Number of the publisher, from 1.
            latched: As in `Ros2Message`.
        """
        ...

    def node_token(self, session: str) -> str:
        """Liveliness token of the whole."""
        ...

    def attachment(self, sequence: int, sender: bytes) -> bytes | None:
        """What goes with each message: its number from 1, its sender (16 bytes)."""
        ...


@dataclass(frozen=True)
class BridgeNaming:
    """Names of zenoh-bridge-ros2dds.

    Attributes:
        namespace: In front of every topic, without slashes around it; may be empty.
    """

    namespace: str = ""

    def key(self, topic: str, kind: str) -> str:
        """As in `Naming`."""
        return _join(self.namespace, topic)

    def token(self, topic: str, kind: str, session: str, entity: int, latched: bool) -> str:
        """As in `Naming`; numbers are those of DDS: reliable 1, transient local 1, keep last 0."""
        key = self.key(topic, kind).replace("/", BRIDGE_SLASH)
        quality = f":1:{1 if latched else 0}:0,{1 if latched else DEPTH}"
        return f"@/{session}/@ros2_lv/MP/{key}/{kind.replace('/', BRIDGE_SLASH)}/{quality}"

    def node_token(self, session: str) -> str:
        """As in `Naming`: says that a bridge is here, which other bridges then listen to."""
        return f"@/{session}/@ros2_lv"

    def attachment(self, sequence: int, sender: bytes) -> bytes | None:
        """As in `Naming`: none."""
        return None


@dataclass(frozen=True)
class RmwNaming:
    """Names of rmw_zenoh, ROS 2 Jazzy and later.

    Attributes:
        domain: ROS_DOMAIN_ID.
        namespace: In front of every topic, without slashes around it; may be empty.
    """

    domain: int = 0
    namespace: str = ""

    def key(self, topic: str, kind: str) -> str:
        """As in `Naming`."""
        return f"{self.domain}/{_join(self.namespace, topic)}/{dds_type(kind)}/{type_hash(kind)}"

    def token(self, topic: str, kind: str, session: str, entity: int, latched: bool) -> str:
        """As in `Naming`; transient local is 1, reliable and keep last are the defaults."""
        name = RMW_SLASH + _join(self.namespace, topic).replace("/", RMW_SLASH)
        quality = f":{'1' if latched else ''}:,{1 if latched else DEPTH}:,:,:,,"
        place = f"@ros2_lv/{self.domain}/{session}/0/{entity}/MP"
        return f"{place}/%/{self._space}/{NODE_NAME}/{name}/{dds_type(kind)}/{type_hash(kind)}/{quality}"

    def node_token(self, session: str) -> str:
        """As in `Naming`."""
        return f"@ros2_lv/{self.domain}/{session}/0/0/NN/%/{self._space}/{NODE_NAME}"

    def attachment(self, sequence: int, sender: bytes) -> bytes | None:
        """As in `Naming`: number, time in [ns] and sender."""
        from zenoh.ext import Int64, z_serialize

        return z_serialize((Int64(sequence), Int64(time.time_ns()), sender)).to_bytes()

    @property
    def _space(self) -> str:
        return RMW_SLASH + self.namespace.replace("/", RMW_SLASH)


def dds_type(kind: str) -> str:
    """Name of a type in DDS, for instance "sensor_msgs::msg::dds_::Image_" of "sensor_msgs/msg/Image"."""
    package, folder, name = kind.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def _join(namespace: str, topic: str) -> str:
    return f"{namespace}/{topic}" if namespace else topic
