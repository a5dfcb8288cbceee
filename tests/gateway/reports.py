"""The status of a gateway that fares well, and how it goes on, for the tests of who reads it."""

from typing import Any

import msgspec

from gateway.clock import ClockReport
from gateway.filter_process.host import HostStatus
from gateway.health import DeviceReport, HealthReport
from gateway.health.report import LinkReport
from gateway.latency import Spread, StageReport
from gateway.machine.realtime import RealtimeStatus
from gateway.messages import FilterTotals
from gateway.modes import Mode
from gateway.outputs.schema import ComponentReport, InnovationReport, NavReport, TargetReport
from gateway.outputs.sinks import SinkStatus
from gateway.statefile import KeeperStatus

replace = msgspec.structs.replace
T_S = 1_795_350_000.0


def device(**changes: Any) -> DeviceReport:
    """A device that fares well."""
    link = LinkReport("udp 127.0.0.1:7001", True, 1, 720_000, 20_000, {})
    clock = ClockReport("sequence", "locked", 1.0, 3.0, 0.02, 0.1)
    report = DeviceReport(
        line="imu0",
        kind="imu",
        codec="kvh1750",
        silent_s=0.0,
        bytes=720_000,
        records=20_000,
        measurements=20_000,
        rejected={},
        rejected_bytes=0,
        ignored={},
        gaps=0,
        missing=0,
        refused_datagrams=0,
        kernel_dropped=0,
        link=link,
        clock=clock,
    )
    return replace(report, **changes)


_SPREAD = Spread(20_000, 900.0, 1900.0, 2500.0, 3000.0)

REPORT = HealthReport(
    vehicle="auv1",
    t_s=T_S,
    up_s=100.0,
    mode=Mode.AIDED,
    fix_age_s=1.2,
    devices={"imu0": device(), "usbl0": device(kind="usbl", codec="tracklink-lxt")},
    filter=HostStatus(4711, 4712, True, 0, 0, 200, 0, 0),
    totals=FilterTotals(20_000, 50, 2, 50, 0, 0, 0, 0),
    outputs=[SinkStatus("zenoh peer", True, 1000, 0, "", 1, 0, 0)],
    latency=[StageReport("total", "zenoh peer", _SPREAD, _SPREAD)],
    realtime=RealtimeStatus(),
    state_file=KeeperStatus("/var/lib/usblnav/state", 1.0, 30, 0),
)


def later(
    report: HealthReport, by_s: float, changes: dict[str, dict[str, Any]] | None = None, **top: Any
) -> HealthReport:
    """The report after a while, with counters of its blocks (of the first device) changed."""
    for block, fields in (changes or {}).items():
        match block:
            case "devices":
                name, first = next(iter(report.devices.items()))
                devices = report.devices | {name: replace(first, **fields)}
                report = replace(report, devices=devices)
            case "outputs":
                report = replace(report, outputs=[replace(report.outputs[0], **fields)])
            case _:
                report = replace(report, **{block: replace(getattr(report, block), **fields)})
    return replace(report, **({"t_s": report.t_s + by_s, "up_s": report.up_s + by_s} | top))


NAV = NavReport(
    utc_ns=round(T_S * 1e9),
    t_s=T_S,
    lat_deg=-33.5,
    lon_deg=-71.25,
    height_m=-123.45,
    vn_m_s=1.0,
    ve_m_s=-1.0,
    vd_m_s=0.1,
    roll_deg=1.0,
    pitch_deg=-2.0,
    heading_deg=315.0,
    sd_n_m=0.4,
    sd_e_m=0.3,
    sd_d_m=0.2,
    sd_vn_m_s=0.01,
    sd_ve_m_s=0.01,
    sd_vd_m_s=0.01,
    sd_roll_deg=0.01,
    sd_pitch_deg=0.01,
    sd_heading_deg=0.05,
    mode=Mode.AIDED,
    fix_age_s=1.2,
    fixes_used=50,
    fixes_rejected=2,
    ellipse_major_m=0.42,
    ellipse_minor_m=0.28,
    ellipse_deg=30.0,
)

INNOVATION = InnovationReport(
    utc_ns=round(T_S * 1e9),
    t_s=T_S,
    device="usbl0",
    beacon="1",
    components=(
        ComponentReport("elevation_deg", 0.5, 0.25),
        ComponentReport("bearing_deg", -0.25, 0.25),
        ComponentReport("range_m", 0.1, 0.2),
    ),
    nis=5.25,
    accepted=True,
    reason="",
)

TARGET = TargetReport(
    **{name: getattr(NAV, name) for name in NAV.__struct_fields__[:8]},
    number=2,
    name="rov",
    beacon="2",
    state="tracked",
    age_s=1.0,
    sd_n_m=2.0,
    sd_e_m=1.0,
    sd_d_m=0.5,
    sd_vn_m_s=0.1,
    sd_ve_m_s=0.1,
    sd_vd_m_s=0.1,
    ellipse_major_m=2.0,
    ellipse_minor_m=1.0,
    ellipse_deg=0.0,
    bearing_deg=36.9,
    range_m=500.0,
)
