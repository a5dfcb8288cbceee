"""Keys, liveliness tokens and attachments by which ROS 2 finds a publisher on Zenoh.

``rmw_zenoh`` (the middleware of Jazzy and later, and of Humble without type hashes)::

    <domain>/<namespace>/<topic>/<type>/<hash>
    @ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<name>
        [/<topic>/<type>/<hash>/<qos>]

and with each sample an attachment of sequence number, source time (Unix ns) and identity, which is
a hash of the publisher's token (this attachment since April 2025: 0.2.4 in Jazzy).
``ros2dds`` (zenoh-plugin-ros2dds, the bridge to DDS)::

    <namespace>/<topic>
    @/<session>/@ros2_lv/MP/<namespace§topic>/<package§msg§type>/<qos>

Source: docs/design.md of ros2/rmw_zenoh, its ``liveliness_utils.cpp`` and
``attachment_helpers.cpp`` (rolling, 2025); README of zenoh-plugin-ros2dds, and the keys in its
``liveliness_mgt.rs`` (2026).
"""

import re
import struct
from dataclasses import dataclass

import xxhash

NODE_NAME = "usblnav"
NO_HASH = "TypeHashNotSupported"
"""In place of the hash in Humble."""
DEFAULT_QOS = "::,10:,:,:,,"
"""Reliable, volatile, the last 10: what an ordinary subscription asks for."""
BRIDGE_QOS = ":1:0:0,10"
"""The same in the bridge's words: no keys, reliable, volatile, keep the last 10."""
_ATTACHMENT = struct.Struct("<qqB16s")
"""Sequence number, source time, length of the identity, identity."""


@dataclass(frozen=True)
class MessageType:
    """A type of message by its name in ROS and the hash of its definition (REP-2016)."""

    package: str
    name: str
    hash: str

    @property
    def ros(self) -> str:
        """Its name in ROS."""
        return f"{self.package}/msg/{self.name}"

    @property
    def dds(self) -> str:
        """Its name on the wire."""
        return f"{self.package}::msg::dds_::{self.name}_"


ODOMETRY = MessageType(
    "nav_msgs",
    "Odometry",
    "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
)
NAV_SAT_FIX = MessageType(
    "sensor_msgs",
    "NavSatFix",
    "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
)
IMU = MessageType(
    "sensor_msgs",
    "Imu",
    "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
)
DIAGNOSTICS = MessageType(
    "diagnostic_msgs",
    "DiagnosticArray",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
)


def namespace_of(vehicle: str) -> str:
    """A vehicle's name as ROS allows it: letters, digits and underscores."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", vehicle)
    return f"_{name}" if name[0].isdigit() else name


@dataclass(frozen=True)
class Node:
    """Our node in a ROS 2 system that speaks Zenoh.

    Attributes
    ----------
    domain
        ``ROS_DOMAIN_ID``.
    session
        Identity of the Zenoh session, in hexadecimal.
    namespace
        Without slash; "" is the root.
    hashes
        Whether keys hold the hashes of types; those of Humble do not.
    """

    domain: int
    session: str
    namespace: str
    hashes: bool = True

    def key(self, topic: str, kind: MessageType) -> str:
        """Where samples of a topic (``/auv1/odometry``) go."""
        return "/".join((str(self.domain), topic.strip("/"), kind.dds, self._hash(kind)))

    def token(self) -> str:
        """Liveliness token of the node itself."""
        return self._token(0, "NN")

    def publisher_token(self, entity: int, topic: str, kind: MessageType) -> str:
        """Liveliness token of a publisher; ``entity`` is its number in the session."""
        parts = (_mangled(topic), kind.dds, self._hash(kind), DEFAULT_QOS)
        return "/".join((self._token(entity, "MP"), *parts))

    def bridge_token(self, topic: str, kind: MessageType) -> str:
        """Liveliness token by which a bridge lists a topic before anybody asks for it."""
        qos = f"{BRIDGE_QOS}:typehash={kind.hash};" if self.hashes else BRIDGE_QOS
        parts = (_escaped(topic.strip("/")), _escaped(kind.ros), qos)
        return "/".join(("@", self.session, "@ros2_lv", "MP", *parts))

    def _token(self, entity: int, kind: str) -> str:
        owner = ("%", _mangled(f"/{self.namespace}"), NODE_NAME)
        return "/".join(
            ("@ros2_lv", str(self.domain), self.session, "0", str(entity), kind, *owner)
        )

    def _hash(self, kind: MessageType) -> str:
        return kind.hash if self.hashes else NO_HASH


def identity(token: str) -> bytes:
    """By which ROS 2 knows a publisher, in samples and in its graph: its token's XXH3, 16 bytes."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def attachment(sequence: int, utc_ns: int, who: bytes) -> bytes:
    """What goes with a sample."""
    return _ATTACHMENT.pack(sequence, utc_ns, len(who), who)


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _escaped(name: str) -> str:
    return name.replace("/", "§")
