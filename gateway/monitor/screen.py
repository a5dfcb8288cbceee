"""One screen of the monitor: 80 by 24 and larger."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from gateway.health import HealthReport
from gateway.latency import Spread
from gateway.modes import Mode
from gateway.monitor.alarms import Alarm, Severity
from gateway.monitor.heard import Heard
from gateway.monitor.picture import draw
from gateway.outputs.schema import InnovationReport, NavReport, TargetReport

SMALLEST = 80, 24
PICTURE_FROM = 112
"""Columns from which there is room for the picture beside."""
PICTURE_COLUMNS = 32
ALARMS = 4
"""Lines for alarms, at most."""
TARGETS = 4
"""Lines for targets, at most."""
_MODES = {
    Mode.AIDED: "bold green",
    Mode.DEAD_RECKONING: "bold yellow",
    Mode.ALIGNING: "bold yellow",
    Mode.INVALID: "bold red",
    Mode.FAULT: "bold red",
}
_STATES = {"tracked": "green", "coasting": "yellow", "lost": "bold red"}
_SEVERITIES = {Severity.NOTICE: "", Severity.WARNING: "yellow", Severity.ALARM: "bold red"}


def screen(heard: Heard, width: int, height: int, beside: Sequence[str] = ()) -> RenderableType:
    """Everything, in so many columns and lines.

    Parameters
    ----------
    beside
        Names of other vehicles that are heard.
    """
    parts: list[RenderableType] = [_head(heard, beside)]
    alarms = [_alarm(alarm) for alarm in heard.alarms()]
    left = height - 1
    if heard.nav is not None:
        solution = _solution(heard.nav)
        parts.append(solution)
        left -= solution.row_count + 1
        if heard.targets:
            targets = _targets(list(heard.targets.values()), heard.nav)
            parts += ["", targets]
            left -= targets.row_count + 2
    below = alarms[:ALARMS]
    if len(alarms) > ALARMS:
        below[-1] = Text(f"and {len(alarms) - ALARMS + 1} more", style="dim")
    left -= len(below) + 1
    if heard.status is not None:
        tables, used = _tables(heard, heard.status, left)
        parts += tables
        left -= used
    if heard.innovations and left >= 2:
        parts += ["", *_innovations(list(heard.innovations)[-(left - 1) :])]
    parts += ["", *below]
    body = Group(*parts)
    if width < PICTURE_FROM or not heard.track:
        return body
    both = Table.grid(padding=(0, 2, 0, 0))
    both.add_column(width=width - PICTURE_COLUMNS - 4)
    both.add_column(width=PICTURE_COLUMNS)
    lines = min(height - 2, PICTURE_COLUMNS // 2 + 2)
    picture = draw(list(heard.track), PICTURE_COLUMNS, lines, heard.targets.values())
    both.add_row(body, Text("\n".join(picture)))
    return both


def _head(heard: Heard, beside: Sequence[str]) -> Text:
    """Vehicle, mode, time, and how long it runs."""
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(heard.vehicle, "bold")
    nav, status = heard.nav, heard.status
    is_old = nav is not None and status is not None and status.mode is Mode.INVALID
    mode = nav.mode if nav and not is_old else status.mode if status else None
    if mode is not None:
        text.append(f"   {mode.value.replace('_', ' ').upper()}", _MODES[mode])
    if nav is not None:
        text.append("   last solution" if is_old else "")
        text.append(f"   {datetime.fromtimestamp(nav.t_s, UTC):%Y-%m-%d %H:%M:%S} UTC")
    if status is not None:
        text.append(f"   up {_span(status.up_s)}", "dim")
    if beside:
        text.append(f"   also {', '.join(beside)}", "dim")
    return text


def _solution(nav: NavReport) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(justify="right", style="dim", no_wrap=True)
    grid.add_column(no_wrap=True)
    speed = math.hypot(nav.vn_m_s, nav.ve_m_s)
    course = math.degrees(math.atan2(nav.ve_m_s, nav.vn_m_s)) % 360.0
    age = "none yet" if nav.fix_age_s is None else f"the last {nav.fix_age_s:.1f} s ago"
    position = f"{_angle(nav.lat_deg, 'NS')}  {_angle(nav.lon_deg, 'EW')}"
    grid.add_row("position", f"{position}  height {nav.height_m:+.2f} m")
    ellipse = f"{nav.ellipse_major_m:.2f} x {nav.ellipse_minor_m:.2f} m"
    grid.add_row("1 sigma", f"{ellipse} along {nav.ellipse_deg:.0f} deg, down {nav.sd_d_m:.2f} m")
    grid.add_row("moving", f"{speed:.2f} m/s, course {course:05.1f}  down {nav.vd_m_s:+.2f} m/s")
    grid.add_row(
        "attitude",
        f"roll {nav.roll_deg:+.2f}  pitch {nav.pitch_deg:+.2f}  heading {nav.heading_deg:06.2f}"
        f" +- {nav.sd_heading_deg:.2f} deg",
    )
    grid.add_row("fixes", f"{nav.fixes_used} used, {nav.fixes_rejected} refused, {age}")
    return grid


def _targets(targets: Sequence[TargetReport], nav: NavReport) -> Table:
    """A line each: where it is, seen from us, and since when it was not heard."""
    table = _table("target", "", "range m", "bearing", "below m", "1 sigma m", "last fix s")
    shown = targets if len(targets) <= TARGETS else targets[: TARGETS - 1]
    for target in sorted(shown, key=lambda target: target.number):
        table.add_row(
            target.name,
            Text(target.state, _STATES[target.state]),
            f"{target.range_m:.1f}",
            f"{target.bearing_deg:05.1f}",
            f"{nav.height_m - target.height_m:.1f}",
            f"{target.ellipse_major_m:.1f}",
            f"{target.age_s:.0f}",
        )
    if len(shown) < len(targets):
        table.add_row(f"and {len(targets) - len(shown)} more")
    return table


def _tables(heard: Heard, status: HealthReport, lines: int) -> tuple[list[RenderableType], int]:
    """Devices and outputs in so many lines, and how many were needed."""
    names = list(status.devices)
    room = max(lines - len(status.outputs) - 4, 2)
    shown = names if len(names) <= room else names[: room - 1]
    devices = _table("device", "codec", "a second", "rejected", "silent s", "time by", "+- ms")
    for name in shown:
        device, clock = status.devices[name], status.devices[name].clock
        share = 100.0 * device.rejected_bytes / device.bytes if device.bytes else 0.0
        devices.add_row(
            name,
            device.codec,
            _number(heard.records_hz(name), 1),
            f"{share:.1f} %",
            _number(device.silent_s, 1),
            clock.source,
            _number(clock.sigma_ms, 2),
        )
    if len(shown) < len(names):
        devices.add_row(f"and {len(names) - len(shown)} more")
    outputs = _table("output", "a second", "dropped", "readers", "ms 50 %", "99 %", "max")
    spreads = {row.of: row.recent for row in status.latency if row.stage == "total"}
    for k, output in enumerate(status.outputs):
        spread = spreads.get(output.name, Spread(0, None, None, None, None))
        rate = _number(heard.sent_hz(k), 1) if output.up else Text("down", "yellow")
        outputs.add_row(
            output.name,
            rate,
            str(output.dropped),
            "-" if output.clients is None else str(output.clients),
            *(_ms(us) for us in (spread.p50_us, spread.p99_us, spread.max_us)),
        )
    parts: list[RenderableType] = ["", devices, "", outputs]
    return parts, devices.row_count + outputs.row_count + 4


def _table(*heads: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    for k, head in enumerate(heads):
        numeric = k > 0 and head not in ("", "codec", "time by")
        table.add_column(head, justify="right" if numeric else "left", no_wrap=True)
    return table


def _innovations(innovations: Sequence[InnovationReport]) -> list[Text]:
    """Fixes, the newest last: each component in its sigmas."""
    return [_innovation(innovation) for innovation in innovations]


def _innovation(innovation: InnovationReport) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{datetime.fromtimestamp(innovation.t_s, UTC):%H:%M:%S} ", "dim")
    text.append(f"{innovation.device} {innovation.beacon}".rstrip())
    if innovation.accepted:
        text.append("  used", "green")
    else:
        text.append(f"  {innovation.reason or 'refused'}", "yellow")
    if innovation.nis is not None:
        text.append(f"  NIS {innovation.nis:.1f}")
    for component in innovation.components:
        name, _, unit = component.name.rpartition("_")
        text.append(f"  {name or unit} {component.value / component.sigma:+.1f}σ")
    return text


def _alarm(alarm: Alarm) -> Text:
    style = _SEVERITIES[alarm.severity]
    return Text(str(alarm), style=style, no_wrap=True, overflow="ellipsis")


def _angle(degrees: float, hemispheres: str) -> str:
    """Degrees and minutes, as on a chart."""
    whole, minutes = divmod(round(abs(degrees) * 60.0, 4), 60.0)
    return f"{whole:.0f}°{minutes:07.4f}'{hemispheres[degrees < 0.0]}"


def _span(seconds: float) -> str:
    minutes, whole = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {whole:02d} s"


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _ms(us: float | None) -> str:
    return "-" if us is None else f"{us / 1e3:.2f}"
