"""Publication over Zenoh under ``usblnav/<vehicle>/``; the one module that imports zenoh.

Each key carries JSON (docs/outputs.md). The session is opened in a thread of its own, because a
silent router holds `zenoh.open` for ten seconds, and is opened again, with one line in the log, as
often as that fails. A put hands the payload to Zenoh's threads and drops under congestion: neither
a slow subscriber nor a missing network is ever felt by the caller.
"""

import asyncio
import json
import logging
import re
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import zenoh
from zenoh import ext

from gateway.config import ZenohOutput
from gateway.errors import UsblnavError
from gateway.outputs.background import in_thread
from gateway.outputs.readers import Readers
from gateway.outputs.sinks import SinkStatus

log = logging.getLogger(__name__)

Topic = Literal["nav", "innovation", "calibration", "status"]
TOPICS: tuple[Topic, ...] = ("nav", "innovation", "calibration", "status")
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a peer or router listens and a client looks, when the configuration names nothing."""
RETRY_S = (1.0, 2.0, 5.0, 10.0)
LOOK_S = 1.0
"""Between looks at who reads."""
PATIENCE_S = 1.0
"""How long start and stop wait for Zenoh before they go on without it."""


@asynccontextmanager
async def open_publisher(settings: ZenohOutput, vehicle: str) -> AsyncIterator["ZenohPublisher"]:
    """Publish while the body runs; a session that does not open keeps being tried behind it."""
    publisher = ZenohPublisher(settings, vehicle)
    keeper = asyncio.create_task(publisher.keep_open(), name=publisher.name)
    try:
        with suppress(TimeoutError):
            await asyncio.wait_for(publisher.tried.wait(), PATIENCE_S)
        yield publisher
    finally:
        keeper.cancel()
        await asyncio.wait([keeper])


class ZenohPublisher:
    """The four topics of a vehicle, its liveliness token, and the last word on each for who asks.

    Parameters
    ----------
    settings
        Mode and endpoints.
    vehicle
        Second part of every key.
    """

    def __init__(self, settings: ZenohOutput, vehicle: str) -> None:
        self.name = f"zenoh {settings.mode}"
        self.tried = asyncio.Event()
        self._settings = settings
        self._prefix = f"usblnav/{vehicle}"
        self._encoder = msgspec.json.Encoder()
        self._last: dict[Topic, bytes] = {}
        self._line: _Line | None = None
        self._readers = Readers(self.name)
        self._sent = self._dropped = 0
        self._error = ""

    def publish(self, topic: Topic, report: msgspec.Struct | dict[str, Any]) -> None:
        """Send a report as JSON, or count it as dropped; never blocks, never raises.

        The last report of each topic is kept, also while there is no session, and given to late
        subscribers and to queries.
        """
        self._last[topic] = self._encoder.encode(report)
        if self._put(topic, self._last[topic]):
            self._sent += 1
        else:
            self._dropped += 1

    def _put(self, topic: Topic, payload: bytes) -> bool:
        if self._line is None:
            return False
        try:
            self._line.publishers[topic].put(payload)
        except zenoh.ZError:
            return False
        return True

    def status(self) -> SinkStatus:
        """Counts and health, now; a client is up only while it sees its router."""
        up = self._line is not None
        if self._line is not None and self._settings.mode == "client":
            up = bool(self._line.session.info.routers_zid())
        readers = self._readers
        counts = (readers.connected, readers.given_up, readers.stalled)
        return SinkStatus(self.name, up, self._sent, self._dropped, self._error, *counts)

    async def keep_open(self) -> None:
        """Open the session, trying as often as needed, and close it when cancelled."""
        failures = 0
        while self._line is None:
            try:
                line = await in_thread(self._open, zenoh.ZError, late=_Line.close)
            except zenoh.ZError as error:
                self._note_down(error)
                self.tried.set()
                await asyncio.sleep(RETRY_S[min(failures, len(RETRY_S) - 1)])
                failures += 1
            else:
                self._note_up(line)
                self.tried.set()
        try:
            while True:
                await asyncio.sleep(LOOK_S)
                links = self._line.session.info.links()
                self._readers.look((_ip(link.src), _ip(link.dst)) for link in links)
        finally:
            line, self._line = self._line, None
            with suppress(TimeoutError):
                await asyncio.wait_for(in_thread(line.close, zenoh.ZError), PATIENCE_S)

    def _open(self) -> "_Line":
        session = zenoh.open(_configuration(self._settings))
        try:
            return _Line(
                session,
                {topic: _declare(session, f"{self._prefix}/{topic}") for topic in TOPICS},
                session.liveliness().declare_token(self._prefix),
                session.declare_queryable(f"{self._prefix}/*", self._answer),
            )
        except zenoh.ZError:
            session.close()
            raise

    def _answer(self, query: zenoh.Query) -> None:
        """Reply with the last word on every key asked for; called from a thread of Zenoh's."""
        with query:
            for topic, payload in tuple(self._last.items()):
                key = zenoh.KeyExpr(f"{self._prefix}/{topic}")
                if query.key_expr.intersects(key):
                    query.reply(key, payload, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _note_up(self, line: "_Line") -> None:
        if self._error:
            log.info("output %s: back", self.name)
        self._line, self._error = line, ""
        for topic, payload in self._last.items():
            self._put(topic, payload)

    def _note_down(self, error: zenoh.ZError) -> None:
        why = _plain(error)
        if why != self._error:
            log.warning("output %s: %s; trying again", self.name, why)
        self._error = why


@dataclass(frozen=True)
class _Line:
    """An open session with what was declared on it, which lives as long as this holds it."""

    session: zenoh.Session
    publishers: dict[Topic, ext.AdvancedPublisher]
    token: zenoh.LivelinessToken
    queryable: zenoh.Queryable[None]

    def close(self) -> None:
        """Close the session; a process that ends with callbacks declared and no close hangs."""
        self.session.close()


def _configuration(settings: ZenohOutput) -> zenoh.Config:
    """Everything explicit: by default Zenoh listens on all interfaces and scouts by multicast."""
    listen, connect = settings.listen, settings.connect
    if not listen and not connect:
        if settings.mode == "client":
            connect = (DEFAULT_ENDPOINT,)
        else:
            listen = (DEFAULT_ENDPOINT,)
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(settings.mode))
    config.insert_json5("listen/endpoints", json.dumps(listen))
    config.insert_json5("connect/endpoints", json.dumps(connect))
    config.insert_json5("scouting/multicast/enabled", json.dumps(settings.multicast))
    # The hardened service may not make shared memory, and a few hundred bytes need none.
    config.insert_json5("transport/shared_memory/enabled", "false")
    return config


def _declare(session: zenoh.Session, key: str) -> ext.AdvancedPublisher:
    return ext.declare_advanced_publisher(
        session,
        key,
        encoding=zenoh.Encoding.APPLICATION_JSON,
        congestion_control=zenoh.CongestionControl.DROP,
        express=False,
        cache=ext.CacheConfig(max_samples=1),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
        publisher_detection=True,
    )


def _ip(endpoint: str) -> str:
    """Address and port of an endpoint such as tcp/127.0.0.1:7447."""
    return endpoint.partition("/")[2].partition("?")[0]


def _plain(error: zenoh.ZError) -> str:
    """Zenoh's message without the places in its source code."""
    text = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
    inner = re.search(r'msg: "([^"]*)"', text)
    text = inner[1] if inner else text
    return "nobody answers" if text.startswith("Unable to connect") else text


def ask(endpoint: str, key: str, within_s: float = 2.0) -> dict[str, bytes]:
    """Ask what listens at an endpoint for the last word on a key or a pattern of keys.

    Returns
    -------
    The payload of each key that was answered, in the order of the keys.

    Raises
    ------
    UsblnavError
        If nobody answers there.
    """
    with _session(endpoint) as session:
        replies = session.get(key, timeout=within_s)
        answers = {str(r.ok.key_expr): r.ok.payload.to_bytes() for r in replies if r.ok}
    return dict(sorted(answers.items()))


@contextmanager
def open_subscription(
    endpoint: str, key: str, on_payload: Callable[[bytes], None]
) -> Iterator[None]:
    """Hear a key of another process for as long as the body runs, its last value first.

    Parameters
    ----------
    endpoint
        Where that process listens, ``tcp/host:port``.
    on_payload
        Called from a thread of Zenoh's.

    Raises
    ------
    UsblnavError
        If nobody answers there.
    """
    with _session(endpoint) as session:
        ext.declare_advanced_subscriber(
            session,
            key,
            lambda sample: on_payload(sample.payload.to_bytes()),
            history=ext.HistoryConfig(detect_late_publishers=True),
        )
        yield


@contextmanager
def _session(endpoint: str) -> Iterator[zenoh.Session]:
    """Be a client of what listens at an endpoint."""
    settings = ZenohOutput(mode="client", connect=(endpoint,))
    try:
        session = zenoh.open(_configuration(settings))
    except zenoh.ZError as error:
        raise UsblnavError(f"zenoh {endpoint}: {_plain(error)}") from error
    try:
        yield session
    finally:
        session.close()
