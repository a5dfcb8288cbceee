"""Opening a session, and in one line why there is none.

Zenoh says only that it could not connect. So the endpoints are tried here once more by hand: does
anything answer, whose certificate is it, or is it we who are not let in?
"""

import socket
import ssl
from contextlib import suppress

import zenoh

from drivers.links.base import reason
from gateway.config import ZenohOutput, ZenohTls
from gateway.errors import UsblnavError
from gateway.outputs.zenoh.settings import configuration, files, plain

ANSWER_S = 2.0
"""How long an endpoint has for an answer."""
ALERT_S = 0.5
"""A refusal of our certificate comes after the handshake, if at all."""


class NoSessionError(UsblnavError):
    """There is no session; the message says why."""


def open_session(settings: ZenohOutput) -> zenoh.Session:
    """Open a session; blocks, at a silent router for ten seconds.

    Raises
    ------
    NoSessionError
        With one line that says why, without secrets.
    """
    try:
        return zenoh.open(configuration(settings))
    except OSError as error:
        key = next((key for key, file in files(settings) if file == error.filename), "file")
        raise NoSessionError(f"{key}: {error.filename}: {reason(error)}") from None
    except zenoh.ZError as error:
        why = plain(error)
        if why.startswith("Unable to connect"):
            why = why_not(settings)
        raise NoSessionError(why) from None


def stamp(source: zenoh.TimestampId, utc_ns: int) -> zenoh.Timestamp:
    """A time (Unix ns) as Zenoh tells it."""
    return zenoh.Timestamp(zenoh.NTP64(*divmod(utc_ns, 1_000_000_000)), source)


def why_not(settings: ZenohOutput) -> str:
    """Why none of the endpoints to connect to gives us a session; blocks."""
    return "; ".join(f"{endpoint}: {_why_not(endpoint, settings)}" for endpoint in settings.connect)


def refuses(why: str) -> bool:
    """Whether somebody answers and lets us in no further: that may still change by itself."""
    return "gives no session" in why


def _why_not(endpoint: str, settings: ZenohOutput) -> str:
    protocol, _, place = endpoint.partition("/")
    host, _, port = place.partition("?")[0].partition("#")[0].rpartition(":")
    if protocol not in ("tcp", "tls") or not port.isdigit():
        return "nobody answers"
    host = host.strip("[]")
    try:
        with socket.create_connection((host, int(port)), ANSWER_S) as line:
            if protocol == "tls":
                _greet(line, host, settings.tls or ZenohTls())
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is refused: {error.verify_message}"
    except ssl.SSLError as error:
        return f"no TLS with it: {(error.reason or str(error)).lower().replace('_', ' ')}"
    except (ConnectionRefusedError, TimeoutError):
        return "nobody answers"
    except OSError as error:
        return reason(error)
    if settings.user is None:
        return "answers, but gives no session: does it want a certificate, or a user and password?"
    return f"answers, but gives no session: wrong password of {settings.user}?"


def _greet(line: socket.socket, host: str, tls: ZenohTls) -> None:
    """Shake hands as Zenoh would."""
    context = ssl.create_default_context(cafile=tls.root_ca)
    context.check_hostname = tls.verify_name
    if tls.mutual and tls.certificate is not None:
        context.load_cert_chain(tls.certificate, tls.private_key)
    with context.wrap_socket(line, server_hostname=host) as secure:
        secure.settimeout(ALERT_S)
        with suppress(TimeoutError):
            secure.recv(1)
