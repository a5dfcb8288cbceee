"""The page: one HTML file that asks nothing of any other place."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from gateway.errors import UsblnavError
from gateway.outputs.schema import titled
from gateway.report.figures import draw
from gateway.report.source import Source

Row = Sequence[str]


def write(source: Source, path: Path) -> None:
    """Write the page.

    Raises
    ------
    UsblnavError
        Where the file cannot be written.
    """
    html = text(source)
    try:
        path.write_text(html, encoding="utf-8")
    except OSError as error:
        raise UsblnavError(f"{path}: cannot write: {error.strerror or error}") from error


def text(source: Source) -> str:
    """The page's text; of the same input always the same."""
    template = Template(files("gateway.report").joinpath("page.html").read_text("utf-8"))
    vehicle = source.config.vehicle if source.config else source.folder.name
    figures = "\n".join(
        f'<figure id="{name}">{svg}<figcaption>{escape(caption)}</figcaption></figure>'
        for name, (caption, svg) in draw(source).items()
    )
    return template.substitute(
        title=escape(f"{vehicle}: navigation report"),
        period=escape(_period(source)),
        tiles="".join(_tile(*tile) for tile in _tiles(source)),
        figures=figures,
        alignment=_section("Finding the attitude", _table(_alignments(source))),
        accuracy=_section("Against the truth", _table(_accuracy(source))),
        devices=_section("Devices", _table(_devices(source))),
        fixes=_section("Fixes that were not used", _table(_refusals(source))),
        calibration=_section("Constants at the end", _table(_constants(source))),
        config=escape(source.config_text),
        version=escape(version("usblnav")),
    )


def _period(source: Source) -> str:
    t_s = source.nav["t_s"]
    begin, end = (datetime.fromtimestamp(float(t), UTC) for t in (t_s[0], t_s[-1]))
    until = f"{end:%H:%M:%S}" if begin.date() == end.date() else f"{end:%Y-%m-%d %H:%M:%S}"
    return f"{begin:%Y-%m-%d %H:%M:%S} to {until} UTC, {_span(float(t_s[-1] - t_s[0]))}"


def _tiles(source: Source) -> Iterator[tuple[str, str, str]]:
    """Figure, what it is, and what to hold it against."""
    nav = source.nav
    aided = nav.modes == "aided"
    yield f"{100.0 * float(np.mean(aided)):.1f} %", "aided", "of the solutions"
    if aided.any():
        horizontal = np.hypot(nav["sd_n_m"], nav["sd_e_m"])[aided]
        worst = f"95 % below {np.quantile(horizontal, 0.95):.2f} m"
        yield f"{np.median(horizontal):.2f} m", "horizontal 1 sigma", f"median while aided; {worst}"
        heading = nav["sd_heading_deg"][aided]
        yield f"{np.median(heading):.3f} deg", "heading 1 sigma", "median while aided"
    told = source.summary.get("filter", {})
    if "fixes_used" in told:
        yield str(told["fixes_used"]), "fixes used", f"{told.get('gated', 0)} refused"
    if told.get("mean_nis") is not None and told.get("expected_nis"):
        ratio = told["mean_nis"] / told["expected_nis"]
        yield f"{ratio:.2f}", "NIS over its expectation", "1 where the noise is as declared"
    if source.errors is not None:
        rms = float(np.sqrt(np.mean(np.square(source.errors.horizontal_m))))
        yield f"{rms:.2f} m", "horizontal RMS error", "against the truth, all of the run"


def _accuracy(source: Source) -> Iterator[Row]:
    found = source.errors
    if found is None:
        return
    yield "error", "RMS", "95 %", "worst", "within 3 sigma"
    names = {"north_m": "m", "east_m": "m", "down_m": "m", "heading_deg": "deg"}
    for name, unit in names.items():
        error, sigma = np.abs(getattr(found, name)), found.sigma[name]
        yield (
            name.rpartition("_")[0],
            f"{np.sqrt(np.mean(np.square(error))):.3f} {unit}",
            f"{np.quantile(error, 0.95):.3f} {unit}",
            f"{error.max():.3f} {unit}",
            f"{100.0 * float(np.mean(error <= 3.0 * sigma)):.1f} %",
        )


def _alignments(source: Source) -> Iterator[Row]:
    if not source.alignments:
        return
    yield "window from, UTC", "roll", "pitch", "heading", ""
    for window in source.alignments:
        found = (window.found.get(f"{name}_deg") for name in ("roll", "pitch", "heading"))
        yield (
            f"{datetime.fromtimestamp(window.t_s, UTC):%H:%M:%S}",
            *("-" if one is None else f"{one[0]:z.2f} ± {one[1]:.2f} deg" for one in found),
            "used" if window.accepted else window.reason,
        )


def _devices(source: Source) -> Iterator[Row]:
    devices: dict[str, dict[str, Any]] = source.summary.get("devices", {})
    if not devices:
        return
    yield (
        *("device", "records", "used", "rejected bytes", "why", "gaps", "missing"),
        *("time by", "drift ppm", "sigma ms", "began anew"),
    )
    for name, told in devices.items():
        clock = told.get("clock", {})
        why = told.get("rejected", {}) | told.get("ignored", {})
        yield (
            name,
            *(str(told.get(key, "")) for key in ("records", "measurements", "rejected_bytes")),
            ", ".join(f"{reason} {count}" for reason, count in why.items()) or "-",
            *(str(told.get(key, "")) for key in ("gaps", "missing")),
            str(clock.get("source") or "-"),
            *(_number(clock.get(key)) for key in ("drift_ppm", "sigma_ms")),
            str(clock.get("resets", "")),
        )


def _refusals(source: Source) -> Iterator[Row]:
    rows: dict[tuple[str, str], int] = dict(source.refused)
    for (device, _), found in source.innovations.items():
        rows[device, "gate"] = max(rows.get((device, "gate"), 0), int((~found.accepted).sum()))
    rows = {key: count for key, count in rows.items() if count}
    if rows:
        yield "device", "reason", "fixes"
        yield from ((device, reason, str(count)) for (device, reason), count in rows.items())


def _constants(source: Source) -> Iterator[Row]:
    if not source.calibration:
        return
    yield "constant", "value", "1 sigma", "1 sigma at the beginning"
    for name, table in source.calibration.items():
        yield titled(name), f"{table[-1, 1]:.5g}", f"{table[-1, 2]:.2g}", f"{table[0, 2]:.2g}"


def _tile(figure: str, what: str, beside: str) -> str:
    return f"<div><b>{escape(figure)}</b><span>{escape(what)}</span><i>{escape(beside)}</i></div>"


def _section(title: str, table: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{table}</section>" if table else ""


def _table(rows: Iterable[Row]) -> str:
    """The first row is the head."""
    head, *body = [*rows] or [()]
    if not body:
        return ""
    lines = [_line("th", head), *(_line("td", row) for row in body)]
    return f'<div class="wide"><table>{"".join(lines)}</table></div>'


def _line(tag: str, cells: Row) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:z.3g}"


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"
