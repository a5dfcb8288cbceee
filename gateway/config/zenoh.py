"""The block of a Zenoh output."""

from typing import Annotated, Any, Literal

from msgspec import Meta, field

from gateway.config.block import Block, Latitude, Longitude

Endpoint = Annotated[
    str,
    Meta(
        pattern=r"\A[a-z0-9]+/\S+\Z",
        description="an endpoint such as tcp/192.168.1.5:7447",
    ),
]
File = Annotated[str, Meta(min_length=1)]
RosName = Annotated[
    str,
    Meta(
        pattern=r"\A(/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*|/)\Z",
        description="a namespace of ROS such as auv1 or fleet/auv1",
    ),
]


class ZenohTls(Block, frozen=True, kw_only=True):
    """Certificates for endpoints of tls and quic: files in PEM."""

    root_ca: File | None = None
    """Who signs those of the others; without it the authorities of the web do."""
    certificate: File | None = None
    """Our own: shown to who connects here, and with ``mutual`` to whom we connect."""
    private_key: File | None = None
    mutual: bool = False
    """Both ends show a certificate."""
    verify_name: bool = True
    """Whether a router's certificate must be of the host that ``connect`` names."""


class MapOrigin(Block, frozen=True, kw_only=True):
    """Where a map begins; its axes are east, north and up there."""

    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float = 0.0


class ZenohRos(Block, frozen=True, kw_only=True):
    """Messages of ROS 2 beside the JSON."""

    origin: MapOrigin
    keys: Literal["rmw_zenoh", "ros2dds"] = "rmw_zenoh"
    """Who reads: a ROS 2 system with the Zenoh middleware, or the bridge to one with DDS."""
    domain: Annotated[int, Meta(ge=0, le=232)] = 0
    """``ROS_DOMAIN_ID``; the bridge has its own."""
    namespace: RosName | None = None
    """Of the topics; without it the vehicle's name."""
    type_hashes: bool = True
    """Keys with the hashes of types, as from Iron on; Humble has none."""
    frame: str = "map"
    child_frame: str = "base_link"
    rate_hz: Annotated[float, Meta(gt=0, le=1000)] = 10.0


class ZenohOutput(Block, frozen=True, kw_only=True, tag_field="type", tag="zenoh"):
    """Publication under ``usblnav/<vehicle>/``."""

    mode: Literal["peer", "client", "router"] = "peer"
    rate_hz: Annotated[float, Meta(gt=0, le=10_000)] = 10.0
    express: bool | None = None
    """Whether solutions are sent at once, each alone; without it up to 16 a second are."""
    connect: tuple[Endpoint, ...] = ()
    listen: tuple[Endpoint, ...] = ()
    multicast: bool = False
    history_s: Annotated[float, Meta(ge=0, le=3600)] = 120.0
    """What queries with a time may ask for."""
    tls: ZenohTls | None = None
    user: Annotated[str, Meta(min_length=1)] | None = None
    password_file: File | None = None
    """Its first line is the password of ``user``."""
    users_file: File | None = None
    """Who may connect here: lines of user:password."""
    ros: ZenohRos | None = None
    config: dict[str, Any] = field(default_factory=dict)
    """Any further setting, in Zenoh's own words."""
