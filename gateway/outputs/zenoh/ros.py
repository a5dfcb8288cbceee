"""Messages of ROS 2 on a Zenoh session: declared as a node of ROS would, at a rate of their own."""

import time
from dataclasses import dataclass
from typing import Any

import zenoh

from gateway.config import ZenohRos
from gateway.outputs.ros.messages import Mapped, diagnostics
from gateway.outputs.ros.names import (
    DIAGNOSTICS,
    IMU,
    NAV_SAT_FIX,
    ODOMETRY,
    MessageType,
    Node,
    attachment,
    identity,
    namespace_of,
)
from gateway.outputs.schema import NavReport


@dataclass
class _Topic:
    """One publisher and its count."""

    publisher: zenoh.Publisher
    identity: bytes
    token: zenoh.LivelinessToken
    sequence: int = 0

    def put(self, payload: bytes | None) -> None:
        if payload is None:
            return
        self.sequence += 1
        what = attachment(self.sequence, time.time_ns(), self.identity)
        self.publisher.put(payload, attachment=what)


class RosTopics:
    """Odometry, fix, attitude and diagnostics of a vehicle.

    Parameters
    ----------
    session
        Open; what is declared on it goes with it.
    settings
        Kind of keys, domain, names and origin.
    vehicle
        Gives the namespace where the settings do not.
    """

    def __init__(self, session: zenoh.Session, settings: ZenohRos, vehicle: str) -> None:
        name = (
            namespace_of(vehicle) if settings.namespace is None else settings.namespace.strip("/")
        )
        self._session = session
        self._bridged = settings.keys == "ros2dds"
        self._node = Node(settings.domain, str(session.zid()), name, settings.type_hashes)
        self._period_ns = round(1e9 / settings.rate_hz)
        self._tick: int | None = None
        self._mapped = Mapped(settings)
        above = f"/{name}" if name else ""
        self._odometry = self._declare(1, f"{above}/odometry", ODOMETRY)
        self._fix = self._declare(2, f"{above}/fix", NAV_SAT_FIX)
        self._imu = self._declare(3, f"{above}/imu/data", IMU)
        self._diagnostics = self._declare(4, "/diagnostics", DIAGNOSTICS)
        self._token = (
            None if self._bridged else session.liveliness().declare_token(self._node.token())
        )

    def nav(self, report: NavReport) -> None:
        """Send a solution that begins a period."""
        tick = report.utc_ns // self._period_ns
        if tick != self._tick:
            self._tick = tick
            self._odometry.put(self._mapped.odometry(report))
            self._imu.put(self._mapped.imu(report))
            self._fix.put(self._mapped.nav_sat_fix(report))

    def status(self, report: Any) -> None:
        """Send how the gateway fares."""
        self._diagnostics.put(diagnostics(report, time.time_ns()))

    def _declare(self, entity: int, topic: str, kind: MessageType) -> _Topic:
        node = self._node
        if self._bridged:
            key, token = topic.strip("/"), node.bridge_token(topic, kind)
        else:
            key, token = node.key(topic, kind), node.publisher_token(entity, topic, kind)
        publisher = self._session.declare_publisher(
            key,
            encoding=zenoh.Encoding.APPLICATION_CDR,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        held = self._session.liveliness().declare_token(token)
        return _Topic(publisher, identity(token), held)
