"""`usblnav calibrate`: what a replay says about the acoustic array."""

import json
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gateway.errors import ConfigError

if TYPE_CHECKING:
    from gateway.calibrate import Findings


def run(arguments: Namespace) -> int:
    """Print the numbers and write the figures and the config snippet beside the replay's files."""
    from gateway import calibrate  # after the parsing: it takes a second to import
    from gateway.calibrate.snippet import snippet

    source = calibrate.read(arguments.out)
    findings = calibrate.find(source)
    if findings is None:
        raise ConfigError(
            [
                f"{arguments.out}: no constant of an array was estimated;"
                " give devices.<usbl>.prior in the configuration of the replay"
            ]
        )
    folder = arguments.out / "calibrate"
    folder.mkdir(exist_ok=True)
    yaml = snippet(source, findings)
    (folder / "config.yaml").write_text(yaml)
    report = _plain(findings) | {"smoothed": source.smoothed, "config": yaml}
    (folder / "calibration.json").write_text(json.dumps(report, indent=2) + "\n")
    if arguments.figures != "none":
        from gateway.calibrate import plots

        plots.draw(source, findings, folder, arguments.figures)
    if arguments.json:
        print(json.dumps(report, indent=2))
        return 0
    for line in _lines(findings, source.config.sound_speed_m_s):
        print(line)
    print(f"\n{yaml}\nwritten to {folder}")
    return 0


def _plain(findings: "Findings") -> dict[str, Any]:
    """The findings as JSON has them."""
    return asdict(findings) | {
        "correlation": findings.correlation.round(4).tolist(),
        "enough": findings.enough,
    }


def _lines(findings: "Findings", configured_m_s: float) -> Iterator[str]:
    """For a person."""
    yield f"{findings.device}{'':14}{'value':>12}{'sigma':>11}{'before':>11}"
    for name, c in findings.constants.items():
        yield f"  {name:22}{c.value:12.5g}{c.sigma:11.2g}{c.prior:11.2g}"
    turn, speed = findings.bearing_turn_deg, findings.sound_speed_m_s
    if turn is not None:
        yield f"  {'bearing_turn_deg':22}{turn.value:12.5g}{turn.sigma:11.2g}"
        yield "    (mounting about the array's axis less bearing offset: what turns all bearings)"
    if speed is not None:
        yield f"  {'sound speed (m/s)':22}{speed.value:12.2f}{speed.sigma:11.2g}"
        yield f"    (of the water, by the range scale; configured {configured_m_s:g})"
    if findings.fits:
        yield ""
        yield f"{'residual':24}{'fixes':>7}{'RMS before':>12}{'after':>9}{'sigma':>9}"
        for name, fit in findings.fits.items():
            yield (
                f"  {name:22}{fit.count:7d}{fit.before_rms:12.3g}{fit.after_rms:9.3g}"
                f"{fit.sigma:9.3g}"
            )
    yield ""
    yield from _verdict(findings)


def _verdict(findings: "Findings") -> Iterator[str]:
    """What the run could not tell."""
    if findings.enough:
        yield "The manoeuvres were enough."
    else:
        yield "The manoeuvres were NOT enough."
    for pair in findings.pairs:
        yield f"  {pair.one} and {pair.other} go together (correlation {pair.correlation:+.2f}):"
        yield f"    {pair.advice}"
    for one in findings.unseen:
        taken = f" (may be taken for {one.partner})" if one.partner else ""
        yield f"  {one.name}: sigma still {100 * one.share:.0f} % of what it was before{taken}:"
        yield f"    {one.advice}"
