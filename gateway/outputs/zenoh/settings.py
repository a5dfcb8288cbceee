"""From the block of a Zenoh output to Zenoh's own configuration, with every fault by its path.

Everything is explicit: by default Zenoh listens on all interfaces and scouts by multicast.
"""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh

from drivers.links.base import reason
from gateway.config import ZenohOutput, ZenohTls

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a peer or router listens and a client looks, when the configuration names nothing."""
EXPRESS_QUEUE = 16
"""Packets of navigation that may wait for a connection, the most Zenoh has; the rest is dropped."""

_OWN_KEYS = {
    "mode": "mode",
    "connect/endpoints": "connect",
    "listen/endpoints": "listen",
    "scouting/multicast/enabled": "multicast",
    "transport/auth/usrpwd": "user, password_file and users_file",
    "transport/link/tls/root_ca_certificate": "tls.root_ca",
    "transport/link/tls/listen_certificate": "tls.certificate",
    "transport/link/tls/connect_certificate": "tls.certificate",
    "transport/link/tls/listen_private_key": "tls.private_key",
    "transport/link/tls/connect_private_key": "tls.private_key",
    "transport/link/tls/enable_mtls": "tls.mutual",
    "transport/link/tls/verify_name_on_connect": "tls.verify_name",
}
"""Zenoh's settings that have keys of ours."""
_SECRET = re.compile(r"_(base64|pem)$")
"""Ends of the names of settings that hold a key itself, not the file it is in."""


def configuration(settings: ZenohOutput) -> zenoh.Config:
    """Zenoh's configuration, the password read from its file.

    Raises
    ------
    OSError
        If a file is not there or may not be read.
    zenoh.ZError
        If Zenoh does not take a setting.
    """
    for _, file in files(settings):
        with Path(file).open("rb"):
            pass
    tree = _tree(settings)
    if settings.user is not None and settings.password_file is not None:
        lines = Path(settings.password_file).read_text("utf-8", "replace").splitlines()
        known = tree["transport"]["auth"]["usrpwd"]
        known |= {"user": settings.user, "password": lines[0] if lines else ""}
    return zenoh.Config.from_json5(json.dumps(tree))


def files(settings: ZenohOutput) -> Iterator[tuple[str, str]]:
    """Key and name of each file that the block names."""
    tls = settings.tls or ZenohTls()
    named = {
        "tls.root_ca": tls.root_ca,
        "tls.certificate": tls.certificate,
        "tls.private_key": tls.private_key,
        "password_file": settings.password_file,
        "users_file": settings.users_file,
    }
    for key, file in named.items():
        if file is not None:
            yield key, file


def faults(settings: ZenohOutput, path: str) -> Iterator[str]:
    """What Zenoh would not take, and what is not for its own words.

    Parameters
    ----------
    path
        Where the block stands in the file.
    """
    for place, value in _walk(settings.config):
        key = f"{path}.config.{place.replace('/', '.')}"
        if place in _OWN_KEYS:
            yield f"{key}: is set by {_OWN_KEYS[place]} of the output itself"
        elif _SECRET.search(place) and value is not None:
            yield f"{key}: secrets stand in files of their own"
    for place, why in _refused(settings.config, ""):
        yield f"{path}.config.{place.replace('/', '.')}: {why}"


def is_express(settings: ZenohOutput) -> bool:
    """Whether each solution goes alone: unless it is said, while the queue holds a second of them.

    Those that share a packet are no later as long as the connection takes them, and outlast a
    stall of seconds.
    """
    fits = settings.rate_hz <= EXPRESS_QUEUE
    return fits if settings.express is None else settings.express


def missing_files(settings: ZenohOutput, path: str) -> Iterator[str]:
    """Files of the block that cannot be read here and now."""
    for key, file in files(settings):
        try:
            with Path(file).open("rb"):
                pass
        except OSError as error:
            yield f"{path}.{key}: {file}: {reason(error)}"


def plain(error: zenoh.ZError) -> str:
    """Zenoh's message without the places in its source code."""
    text = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
    inner = re.search(r'(?:msg: |Str\()"([^"]*)"', text)
    return (inner[1] if inner else text).strip()


def _tree(settings: ZenohOutput) -> dict[str, Any]:
    listen, connect = settings.listen, settings.connect
    if not listen and not connect:
        if settings.mode == "client":
            connect = (DEFAULT_ENDPOINT,)
        else:
            listen = (DEFAULT_ENDPOINT,)
    tree = {
        "mode": settings.mode,
        "listen": {"endpoints": listen},
        "connect": {"endpoints": connect},
        "scouting": {"multicast": {"enabled": settings.multicast}},
        "transport": {
            # The hardened service may not make shared memory, and a few hundred bytes need none.
            "shared_memory": {"enabled": False},
            "link": {
                "tx": {"queue": {"size": {"real_time": EXPRESS_QUEUE}}},
                "tls": _tls(settings.tls or ZenohTls()),
            },
            "auth": {"usrpwd": {"dictionary_file": settings.users_file}},
        },
    }
    return _merged(tree, settings.config)


def _tls(tls: ZenohTls) -> dict[str, Any]:
    return {
        "root_ca_certificate": tls.root_ca,
        "listen_certificate": tls.certificate,
        "listen_private_key": tls.private_key,
        "connect_certificate": tls.certificate,
        "connect_private_key": tls.private_key,
        "enable_mtls": tls.mutual,
        "verify_name_on_connect": tls.verify_name,
    }


def _merged(tree: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Both trees in one; where they meet in a value the second has it."""
    both = dict(tree)
    for key, value in more.items():
        mine = both.get(key)
        if isinstance(mine, Mapping) and isinstance(value, Mapping):
            both[key] = _merged(mine, value)
        else:
            both[key] = value
    return both


def _walk(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Every node below the root, by its place."""
    for key, value in tree.items():
        place = f"{above}{key}"
        yield place, value
        if isinstance(value, Mapping):
            yield from _walk(value, f"{place}/")


def _refused(tree: Mapping[str, Any], above: str) -> Iterator[tuple[str, str]]:
    """The deepest settings that Zenoh does not take, and why."""
    for key, value in tree.items():
        place = f"{above}{key}"
        why = _why_refused(place, value)
        if why is None:
            continue
        below = list(_refused(value, f"{place}/")) if isinstance(value, Mapping) else []
        # What is given by mode is known to Zenoh as a whole only.
        named = re.match(r"unknown field `([^`]*)`", why)
        below = [
            (at, w) for at, w in below if w != "unknown key" or (named and at.endswith(named[1]))
        ]
        yield from below or [(place, why)]


def _why_refused(place: str, value: Any) -> str | None:
    try:
        zenoh.Config().insert_json5(place, json.dumps(value))
    except zenoh.ZError as error:
        return plain(error)
    return None
