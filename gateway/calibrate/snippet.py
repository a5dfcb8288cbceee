"""The part of config.yaml that a calibration changes, ready to paste."""

import math

from gateway.calibrate.findings import Findings, array_block
from gateway.calibrate.source import Source


def snippet(source: Source, findings: Findings) -> str:
    """YAML with what it replaces beside it."""
    block, names = array_block(source, findings), findings.constants
    lines = ["devices:", f"  {findings.device}:"]
    if findings.bearing_turn_deg is not None:
        now = _triple(findings.mounting_deg, 3)
        lines.append(f"    mounting_deg: {now}{_was(_triple(block.mounting_deg, 3))}")
    if any(name.startswith("lever") for name in names):
        now = _triple(findings.lever_arm_m, 3)
        lines.append(f"    lever_arm_m: {now}{_was(_triple(block.lever_arm_m, 3))}")
    if "latency_ms" in names:
        clock = f"{{source: {block.clock.source}, latency_ms: {max(findings.latency_ms, 0.0):.1f}}}"
        lines.append(f"    clock: {clock}{_was(f'{block.clock.latency_ms:g}')}")
    lines.append(f"    prior: {{{_prior(source, findings)}}}")
    if "elevation_offset_deg" in names:
        offset = names["elevation_offset_deg"].value
        lines.append(f"    # the elevation offset ({offset:+.3f} deg) has no key: it is found anew")
    if findings.sound_speed_m_s is not None:
        speed, was = findings.sound_speed_m_s.value, source.config.sound_speed_m_s
        lines.append(
            f"sound_speed_m_s: {speed:.2f}{_was(f'{was:g}')}; set the instrument to it too"
        )
    return "\n".join(lines) + "\n"


def _prior(source: Source, findings: Findings) -> str:
    """What is still unknown once the snippet is in; a bearing offset is in the mounting then."""
    prior, names = array_block(source, findings).prior, findings.constants
    known = {"mounting_deg": _up(findings.mounting_sigma_deg), "bearing_deg": 0.0}
    known["elevation_deg"] = prior.elevation_deg
    known["range_scale"] = _up(names["range_scale"].sigma) if "range_scale" in names else 0.0
    lever = [c.sigma for name, c in names.items() if name.startswith("lever")]
    if lever:
        known["lever_arm_m"] = _up(max(lever))
    if "latency_ms" in names:
        known["latency_ms"] = _up(names["latency_ms"].sigma)
    return ", ".join(f"{name}: {value:g}" for name, value in known.items())


def _was(text: str) -> str:
    return f"   # was {text}"


def _triple(values: tuple[float, float, float], decimals: int) -> str:
    return f"[{', '.join(f'{value:.{decimals}f}' for value in values)}]"


def _up(sigma: float) -> float:
    """Two digits, rounded up: a prior should not be smaller than what is known."""
    if sigma <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(sigma)) - 1)
    return float(f"{math.ceil(sigma / unit) * unit:.2g}")
