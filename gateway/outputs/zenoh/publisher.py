"""The reports of a vehicle over Zenoh: as they come, to who joins late, and to who asks.

Each key carries JSON (docs/outputs.md). The session is opened in a thread of its own, because a
silent router holds `zenoh.open` for ten seconds, and is opened again, with one line in the log, as
often as that fails. A put hands the payload to Zenoh's threads and drops under congestion: neither
a slow subscriber nor a missing network is ever felt by the caller.
"""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec
import zenoh
from zenoh import ext

from gateway.config import ZenohOutput
from gateway.outputs.background import in_thread
from gateway.outputs.readers import Readers
from gateway.outputs.sinks import SinkStatus
from gateway.outputs.zenoh.answers import Answers
from gateway.outputs.zenoh.past import Past
from gateway.outputs.zenoh.ros import RosTopics
from gateway.outputs.zenoh.session import NoSessionError, open_session, refuses, stamp, why_not
from gateway.outputs.zenoh.settings import is_express

log = logging.getLogger(__name__)

RETRY_S = (1.0, 2.0, 5.0, 10.0)
LOOK_S = 1.0
"""Between looks at who reads, and at whether there is a way to them."""
SETTLE_S = 6.0
"""A router that has just come back may be heard before Zenoh tries it again, each 4 s at last."""
PATIENCE_S = 1.0
"""How long start and stop wait for Zenoh before they go on without it."""


PRIORITIES: dict[str, zenoh.Priority] = {
    "nav": zenoh.Priority.REAL_TIME,
    "innovation": zenoh.Priority.DATA_HIGH,
    "calibration": zenoh.Priority.DATA_LOW,
    "status": zenoh.Priority.DATA_LOW,
}


@asynccontextmanager
async def open_publisher(
    settings: ZenohOutput, vehicle: str, targets: Sequence[str] = ()
) -> AsyncIterator["ZenohPublisher"]:
    """Publish while the body runs; a session that does not open keeps being tried behind it."""
    publisher = ZenohPublisher(settings, vehicle, targets)
    keeper = asyncio.create_task(publisher.keep_open(), name=publisher.name)
    try:
        with suppress(TimeoutError):
            await asyncio.wait_for(publisher.tried.wait(), PATIENCE_S)
        yield publisher
    finally:
        keeper.cancel()
        await asyncio.wait([keeper])


class ZenohPublisher:
    """The topics of a vehicle, its liveliness token, and their past for who asks.

    Parameters
    ----------
    settings
        Mode, endpoints and all else of the session.
    vehicle
        Second part of every key.
    targets
        Names of what it follows: a topic ``target/<name>`` each.
    """

    def __init__(self, settings: ZenohOutput, vehicle: str, targets: Sequence[str] = ()) -> None:
        self.name = f"zenoh {settings.mode}"
        self.tried = asyncio.Event()
        self._settings = settings
        self._vehicle = vehicle
        self._prefix = f"usblnav/{vehicle}"
        self._encoder = msgspec.json.Encoder()
        followed = {f"target/{name}": zenoh.Priority.DATA_HIGH for name in targets}
        self._priorities = PRIORITIES | followed
        self._past = {topic: Past(settings.history_s) for topic in self._priorities}
        self._line: _Line | None = None
        self._readers = Readers(self.name)
        self._sent = self._dropped = 0
        self._error = ""
        self._lost_at: float | None = None

    def publish(self, topic: str, report: msgspec.Struct | dict[str, Any]) -> None:
        """Send a report as JSON, or count it as dropped; never blocks, never raises.

        Its timestamp on Zenoh is its time of validity, ``utc_ns``, or else now. Reports are kept,
        also while there is no session, for late subscribers and queries.
        """
        payload = self._encoder.encode(report)
        utc_ns = getattr(report, "utc_ns", None) or time.time_ns()
        if self._put(topic, payload, utc_ns):
            self._sent += 1
        else:
            self._dropped += 1
        self._past[topic].add(utc_ns, payload)
        if self._line is not None and self._line.ros is not None:
            self._put_ros(self._line.ros, topic, report)

    def _put(self, topic: str, payload: bytes, utc_ns: int) -> bool:
        line = self._line
        if line is None:
            return False
        try:
            line.publishers[topic].put(payload, timestamp=stamp(line.source, utc_ns))
        except zenoh.ZError:
            return False
        return True

    def _put_ros(self, ros: RosTopics, topic: str, report: Any) -> None:
        try:
            if topic == "nav":
                ros.nav(report)
            elif topic == "status":
                ros.status(report)
        except zenoh.ZError:
            self._dropped += 1

    def status(self) -> SinkStatus:
        """Counts and health, now; who connects is up only while the far end is there."""
        up = self._line is not None and not self._error
        if self._line is not None and self._settings.mode == "client":
            up = bool(self._line.session.info.routers_zid())
        readers = self._readers
        counts = (readers.connected, readers.given_up, readers.stalled)
        return SinkStatus(self.name, up, self._sent, self._dropped, self._error, *counts)

    async def keep_open(self) -> None:
        """Open the session, trying as often as needed, and close it when cancelled."""
        line = await self._opened()
        try:
            while True:
                await asyncio.sleep(LOOK_S)
                await self._look(line)
        finally:
            self._line = None
            with suppress(TimeoutError):
                await asyncio.wait_for(in_thread(line.close, zenoh.ZError), PATIENCE_S)

    async def _opened(self) -> "_Line":
        failures = 0
        while True:
            try:
                line = await in_thread(self._open, NoSessionError, late=_Line.close)
            except NoSessionError as error:
                self._note_down(str(error))
                self.tried.set()
                await asyncio.sleep(RETRY_S[min(failures, len(RETRY_S) - 1)])
                failures += 1
            else:
                self._line = line
                self._note_up()
                for topic, past in self._past.items():
                    if past.last is not None:
                        utc_ns, payload = past.last
                        self._put(topic, payload, utc_ns)
                self.tried.set()
                return line

    async def _look(self, line: "_Line") -> None:
        """See who reads, and whether those we connect to are there; Zenoh itself tries again."""
        links = line.session.info.links()
        self._readers.look((_ip(link.src), _ip(link.dst)) for link in links)
        ports = {endpoint.rpartition(":")[2] for endpoint in self._settings.connect}
        if not ports or any(link.dst.rpartition(":")[2] in ports for link in links):
            self._lost_at = None
            self._note_up()
            return
        now = time.monotonic()
        self._lost_at = self._lost_at or now
        why = await in_thread(partial(why_not, self._settings), NoSessionError)
        if not refuses(why) or now - self._lost_at > SETTLE_S:
            self._note_down(why)

    def _open(self) -> "_Line":
        session, ros = open_session(self._settings), self._settings.ros
        try:
            source = session.new_timestamp().get_id()
            answers = Answers(self._prefix, self._past, source)
            return _Line(
                session,
                source,
                {topic: self._declare(session, topic) for topic in self._priorities},
                session.liveliness().declare_token(self._prefix),
                session.declare_queryable(f"{self._prefix}/**", answers.answer),
                None if ros is None else RosTopics(session, ros, self._vehicle),
            )
        except zenoh.ZError:
            session.close()
            raise

    def _declare(self, session: zenoh.Session, topic: str) -> ext.AdvancedPublisher:
        return ext.declare_advanced_publisher(
            session,
            f"{self._prefix}/{topic}",
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=self._priorities[topic],
            express=topic == "nav" and is_express(self._settings),
            cache=ext.CacheConfig(max_samples=1),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )

    def _note_up(self) -> None:
        if self._error:
            log.info("output %s: back", self.name)
        self._error = ""

    def _note_down(self, why: str) -> None:
        if why != self._error:
            log.warning("output %s: %s; trying again", self.name, why)
        self._error = why


@dataclass(frozen=True)
class _Line:
    """An open session with what was declared on it, which lives as long as this holds it."""

    session: zenoh.Session
    source: zenoh.TimestampId
    publishers: dict[str, ext.AdvancedPublisher]
    token: zenoh.LivelinessToken
    queryable: zenoh.Queryable[None]
    ros: RosTopics | None

    def close(self) -> None:
        """Close the session; a process that ends with callbacks declared and no close hangs."""
        self.session.close()


def _ip(endpoint: str) -> str:
    """Address and port of an endpoint such as tcp/127.0.0.1:7447."""
    return endpoint.partition("/")[2].partition("?")[0]
