"""Topics of a recording with encodings and schemas that Foxglove reads without a plugin."""

import math
import struct
from typing import Any, NamedTuple

import msgspec

from gateway.modes import PLACED
from gateway.outputs.schema import NavReport

RAW = "/raw/"
LINE = "/line/"
PULSE = "/pulse/"
RECORDS = "/records/"
UTC = "/utc"
LOCATION = "/location"

_HEAD = struct.Struct("<QI")
_SIZE = struct.Struct("<I")


class Form(NamedTuple):
    """How the messages of a topic are encoded, and the schema that says so."""

    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


RAW_FORM = Form(
    "ros1",
    "usblnav/Raw",
    "ros1msg",
    b"# A chunk of bytes as it came.\n"
    b"uint64 t_rx_ns  # of the host, never steps\n"
    b"uint8[] data\n"
    b"string source  # who sent it\n",
)


def raw_message(t_rx_ns: int, data: bytes, source: str) -> bytes:
    """Encode a chunk as `RAW_FORM` says."""
    name = source.encode()
    return _HEAD.pack(t_rx_ns, len(data)) + data + _SIZE.pack(len(name)) + name


def read_raw(message: bytes) -> tuple[int, bytes, str]:
    """Receive time, bytes and sender of a chunk; recordings of before 2026-11-22 tell no sender.

    Raises
    ------
    ValueError
        If the message is not whole.
    """
    if len(message) < _HEAD.size:
        raise ValueError("a chunk without its head")
    t_rx_ns, size = _HEAD.unpack_from(message)
    data, rest = message[_HEAD.size : _HEAD.size + size], message[_HEAD.size + size :]
    name = rest[_SIZE.size :]
    if len(data) != size or (rest and rest[: _SIZE.size] != _SIZE.pack(len(name))):
        raise ValueError("a chunk of another length than it says")
    return t_rx_ns, data, name.decode()


def json_form(name: str, schema: dict[str, Any], example: Any = None) -> Form:
    """Form of JSON messages whose schema is one of `msgspec.json.schema`.

    Parameters
    ----------
    example
        A message: where the schema is of a mapping, its keys become properties, so that they can be
        plotted.
    """
    plain = _plain(schema, schema.get("$defs", {}), example)
    return Form("json", f"usblnav.{name}", "jsonschema", msgspec.json.encode(plain))


def _plain(schema: dict[str, Any], types: dict[str, Any], example: Any) -> dict[str, Any]:
    """The same in Foxglove's part of JSON Schema: one type each, no references, no choices."""
    if "$ref" in schema:
        schema = types[schema["$ref"].rpartition("/")[2]]
    choices = [choice for choice in schema.get("anyOf", ()) if choice != {"type": "null"}]
    if choices:
        return _plain(choices[0], types, example)
    told: dict[str, Any] = {k: schema[k] for k in schema if k in ("title", "description")}
    match schema.get("type"):
        case "object":
            given = example if isinstance(example, dict) else {}
            kinds = schema.get("properties", {})
            if not kinds:
                kinds = dict.fromkeys(given, schema.get("additionalProperties", {}))
            properties = {k: _plain(kind, types, given.get(k)) for k, kind in kinds.items()}
            return {**told, "type": "object", "properties": properties}
        case "array":
            items = [*schema.get("prefixItems", ()), schema.get("items")][0]
            item = example[0] if isinstance(example, list) and example else None
            return {**told, "type": "array", "items": _plain(items or {}, types, item)}
        case "number" | "integer" | "boolean" as kind:
            return {**told, "type": kind}
        case _:
            return {**told, "type": "string"}


_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}
LOCATION_FORM = Form(
    "json",
    "foxglove.LocationFix",
    "jsonschema",
    msgspec.json.encode(
        {
            "title": "foxglove.LocationFix",
            "type": "object",
            "properties": {
                "timestamp": _TIME,
                "frame_id": {"type": "string"},
                "latitude": {"type": "number"},
                "longitude": {"type": "number"},
                "altitude": {"type": "number"},
                "position_covariance": {"type": "array", "items": {"type": "number"}},
                "position_covariance_type": {"type": "integer"},
            },
        }
    ),
)
KNOWN_COVARIANCE = 3


def location_message(nav: NavReport) -> bytes | None:
    """The solution for a map, its covariance in east, north, up (m^2); None where there is none."""
    if nav.mode not in PLACED:
        return None
    seconds, nanoseconds = divmod(nav.utc_ns, 1_000_000_000)
    spread = (nav.ellipse_major_m**2 - nav.ellipse_minor_m**2) / 2.0
    cov_ne = spread * math.sin(math.radians(2.0 * nav.ellipse_deg))
    east, north, up = nav.sd_e_m**2, nav.sd_n_m**2, nav.sd_d_m**2
    return msgspec.json.encode(
        {
            "timestamp": {"sec": seconds, "nsec": nanoseconds},
            "frame_id": "wgs84",
            "latitude": nav.lat_deg,
            "longitude": nav.lon_deg,
            "altitude": nav.height_m,
            "position_covariance": (east, cov_ne, 0.0, cov_ne, north, 0.0, 0.0, 0.0, up),
            "position_covariance_type": KNOWN_COVARIANCE,
        }
    )
