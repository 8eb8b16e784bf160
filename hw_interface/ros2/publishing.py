"""Messages of ROS 2 onto a zenoh session, each topic announced as ROS 2's side expects it."""

import os

import zenoh
from zenoh.ext import CacheConfig, MissDetectionConfig, declare_advanced_publisher

from hw_interface.ros2.encoding import Ros2Message
from hw_interface.ros2.keys import Naming

# The transport's own default drops a message that a full link has no room for, which is every large picture. This
# process holds up nobody while it waits: it reads states from a ring and asks for pictures one at a time.
_WAIT = zenoh.CongestionControl.BLOCK


class Ros2Publisher:
    """Publishes messages; topics are announced when their first message comes.

    Args:
        session: The session; whoever opened it closes it.
        naming: Whose names topics get.
    """

    def __init__(self, session: zenoh.Session, naming: Naming) -> None:
        self._session = session
        self._naming = naming
        self._id = str(session.zid())
        self._topics: dict[str, _Topic] = {}
        self._node = session.liveliness().declare_token(naming.node_token(self._id))

    def put(self, message: Ros2Message) -> None:
        """Publish a message."""
        topic = self._topics.get(message.topic)
        if topic is None:
            topic = _Topic(self._session, self._naming, message, self._id, len(self._topics) + 1)
            self._topics[message.topic] = topic
        topic.put(message.data)

    def close(self) -> None:
        """Take all topics back."""
        for topic in self._topics.values():
            topic.close()
        self._node.undeclare()


class _Topic:
    """One topic: its publisher, its token, and how many messages it had."""

    def __init__(self, session: zenoh.Session, naming: Naming, first: Ros2Message, own_id: str, entity: int) -> None:
        key = naming.key(first.topic, first.kind)
        self._naming = naming
        self._sender = os.urandom(16)
        self._sequence = 0
        if first.latched:
            # Keeps the last message for those who come later, as both sides ask for it.
            self._publisher = declare_advanced_publisher(
                session,
                key,
                cache=CacheConfig(1),
                publisher_detection=True,
                # Numbers the messages; sessions here have no time stamps.
                sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
                congestion_control=_WAIT,
            )
        else:
            self._publisher = session.declare_publisher(key, congestion_control=_WAIT)
        token = naming.token(first.topic, first.kind, own_id, entity, first.latched)
        self._token = session.liveliness().declare_token(token)

    def put(self, data: memoryview) -> None:
        self._sequence += 1
        self._publisher.put(bytes(data), attachment=self._naming.attachment(self._sequence, self._sender))

    def close(self) -> None:
        self._token.undeclare()
        self._publisher.undeclare()
