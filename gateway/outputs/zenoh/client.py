"""Hearing a gateway over Zenoh from another program of ours."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import zenoh
from zenoh import ext

from gateway.config import ZenohOutput
from gateway.errors import UsblnavError
from gateway.outputs.zenoh.session import NoSessionError, open_session
from gateway.outputs.zenoh.settings import DEFAULT_ENDPOINT


def at(endpoint: str) -> ZenohOutput:
    """Settings of a client of what listens at an endpoint."""
    return ZenohOutput(mode="client", connect=(endpoint,))


def client_of(output: ZenohOutput) -> ZenohOutput:
    """Settings of a client of the gateway of an output: at its own place, or at its router's."""
    place = next(iter(output.listen or output.connect), DEFAULT_ENDPOINT)
    place = re.sub(r"/(0\.0\.0\.0|\[::\]):", "/127.0.0.1:", place)
    return msgspec.structs.replace(
        output, mode="client", connect=(place,), listen=(), users_file=None
    )


def ask(place: ZenohOutput, key: str, within_s: float = 2.0) -> dict[str, bytes]:
    """Ask for the last word on a key or a pattern of keys.

    Parameters
    ----------
    place
        A client's settings.

    Returns
    -------
    The payload of each key that was answered, in the order of the keys.

    Raises
    ------
    UsblnavError
        If nobody answers there.
    """
    with _session(place) as session:
        replies = session.get(key, timeout=within_s)
        answers = {str(r.ok.key_expr): r.ok.payload.to_bytes() for r in replies if r.ok}
    return dict(sorted(answers.items()))


@contextmanager
def open_subscription(
    place: ZenohOutput, key: str, on_sample: Callable[[str, bytes], None]
) -> Iterator[None]:
    """Hear a key or a pattern of keys while the body runs, the last word on each first.

    Parameters
    ----------
    place
        A client's settings.
    on_sample
        Called with key and payload from a thread of Zenoh's.

    Raises
    ------
    UsblnavError
        If nobody answers there.
    """
    with _session(place) as session:
        ext.declare_advanced_subscriber(
            session,
            key,
            lambda sample: on_sample(str(sample.key_expr), sample.payload.to_bytes()),
            history=ext.HistoryConfig(detect_late_publishers=True),
        )
        yield


@contextmanager
def _session(place: ZenohOutput) -> Iterator[zenoh.Session]:
    try:
        session = open_session(place)
    except NoSessionError as error:
        raise UsblnavError(f"zenoh {error}") from error
    try:
        yield session
    finally:
        session.close()
