"""The numbers of a calibration, what they rest on, and what the run could not tell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.calibrate import advice
from gateway.calibrate.source import Constant, Residuals, Source
from gateway.config import UsblDevice
from gateway.nav.attitude import C_from_euler, euler_from_C
from gateway.nav.lie import exp_so3

Array = NDArray[np.float64]

INSEPARABLE = 0.9
"""Correlation from which on two constants cannot be told apart."""
UNSEEN = 0.7
"""Share of the prior sigma above which the run has told little of a constant."""
PARTNER = 0.5
"""Correlation from which on another is named as what an unseen constant may be taken for."""

_MOUNTING = [f"mounting_{axis}_deg" for axis in "xyz"]
_LEVER = [f"lever_arm_{axis}_m" for axis in "xyz"]
_OF_THE_ARRAY = ("mounting", "elevation", "bearing", "range", "lever", "latency")


@dataclass(frozen=True)
class Number:
    """A value with its sigma."""

    value: float
    sigma: float


@dataclass(frozen=True)
class Pair:
    """Two constants that the run could not tell apart."""

    one: str
    other: str
    correlation: float
    advice: str

    @property
    def for_ever(self) -> bool:
        """Whether no manoeuvre parts them: a turn of the array and an offset of its bearings."""
        return {advice.kind(self.one), advice.kind(self.other)} == {"bearing", "mounting"}


@dataclass(frozen=True)
class Unseen:
    """A constant of which the run told little: its sigma is still ``share`` of the prior one.

    ``partner`` is what it is most easily taken for, None where nothing stands out.
    """

    name: str
    share: float
    partner: str | None
    advice: str


@dataclass(frozen=True)
class Fit:
    """One component of the residuals: mean and RMS before and after, and the white sigma."""

    count: int
    before_mean: float
    before_rms: float
    after_mean: float
    after_rms: float
    sigma: float


@dataclass(frozen=True)
class Findings:
    """A calibration.

    Attributes
    ----------
    device
        The array.
    constants
        Its constants by name.
    bearing_turn_deg
        What turns all bearings: the mounting error about the array's own vertical axis less the
        bearing offset. The two are nearly inseparable, this is not.
    mounting_deg
        Roll, pitch and heading of the array with everything that turns it put in.
    mounting_sigma_deg
        The largest 1-sigma of the three.
    sound_speed_m_s
        What the range scale means; None where it was not estimated.
    names, correlation
        n constants (and attitude angles) and their (n, n) correlations.
    """

    device: str
    constants: dict[str, Constant]
    bearing_turn_deg: Number | None
    mounting_deg: tuple[float, float, float]
    mounting_sigma_deg: float
    sound_speed_m_s: Number | None
    lever_arm_m: tuple[float, float, float]
    latency_ms: float
    names: list[str]
    correlation: Array
    pairs: list[Pair]
    unseen: list[Unseen]
    fits: dict[str, Fit]

    @property
    def enough(self) -> bool:
        """Whether the manoeuvres told apart all that manoeuvres can."""
        return not self.unseen and all(pair.for_ever for pair in self.pairs)


def find(source: Source) -> Findings | None:
    """Make a calibration of a replay; None where it estimated no constant of an array."""
    constants = {n: c for n, c in source.constants.items() if n.startswith(_OF_THE_ARRAY)}
    if not constants or not source.config.usbl:
        return None
    device, block = next(iter(source.config.usbl.items()))
    C_nominal = C_from_euler(*np.radians(block.mounting_deg))
    turned, sigma = _turned(source, C_nominal)
    turn = _bearing_turn(source, C_nominal)
    correlation = _correlation(source.covariance)
    value = {name: constant.value for name, constant in constants.items()}
    return Findings(
        device=device,
        constants=constants,
        bearing_turn_deg=turn,
        mounting_deg=turned,
        mounting_sigma_deg=sigma,
        sound_speed_m_s=_sound_speed(source),
        lever_arm_m=_sum(block.lever_arm_m, [value.get(name, 0.0) for name in _LEVER]),
        latency_ms=block.clock.latency_ms + value.get("latency_ms", 0.0),
        names=source.names,
        correlation=correlation,
        pairs=_pairs(source.names, correlation, constants),
        unseen=[
            _explained(name, share, source.names, correlation)
            for name, share in _shares(constants, turn, C_nominal).items()
            if share > UNSEEN
        ],
        fits={name: _fit(rows) for name, rows in source.residuals.items()},
    )


def _combination(source: Source, weights: dict[str, float]) -> Number:
    """A weighted sum of constants with its sigma; one that was not estimated counts as zero."""
    w = np.array([weights.get(name, 0.0) for name in source.names])
    value = sum(w * source.constants[n].value for n, w in weights.items() if n in source.constants)
    return Number(float(value), float(np.sqrt(max(w @ source.covariance @ w, 0.0))))


def _bearing_turn(source: Source, C_bu: Array) -> Number | None:
    """The mounting error about the array's z axis less the bearing offset.  # (M.108)"""
    if not {"bearing_offset_deg", *_MOUNTING} & source.constants.keys():
        return None
    axis = dict(zip(_MOUNTING, C_bu[:, 2].tolist(), strict=True))
    return _combination(source, axis | {"bearing_offset_deg": -1.0})


def _turned(source: Source, C_bu: Array) -> tuple[tuple[float, float, float], float]:
    """Euler angles (deg) of the array with its estimated turn, and their largest sigma.

    A bearing offset is a turn about the array's own axis, ``Exp(theta) C_bu Rz(-dbeta)``: exact
    for any bearing and elevation.  # (M.109)
    """
    value = {name: constant.value for name, constant in source.constants.items()}
    theta = np.radians([value.get(name, 0.0) for name in _MOUNTING])
    offset = np.radians(value.get("bearing_offset_deg", 0.0))
    C = exp_so3(theta) @ C_bu @ exp_so3(np.array([0.0, 0.0, -offset]))
    roll, pitch, heading = (float(angle) for angle in np.degrees(euler_from_C(C)))
    sigmas = [
        _combination(source, {name: 1.0, "bearing_offset_deg": -float(C[i, 2])}).sigma
        for i, name in enumerate(_MOUNTING)
    ]
    return (roll, pitch, heading), max(sigmas)


def _sound_speed(source: Source) -> Number | None:
    """Range measured = true (1 + dKd) = travel time x configured speed.  # (M.110)"""
    scale = source.constants.get("range_scale")
    if scale is None:
        return None
    speed = source.config.sound_speed_m_s / (1.0 + scale.value)
    return Number(speed, speed * scale.sigma)


def _sum(nominal: tuple[float, float, float], estimated: list[float]) -> tuple[float, float, float]:
    x, y, z = (a + b for a, b in zip(nominal, estimated, strict=True))
    return x, y, z


def _correlation(covariance: Array) -> Array:
    sd = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    sd[sd == 0.0] = 1.0
    found: Array = covariance / np.outer(sd, sd)
    return found


def _pairs(names: list[str], correlation: Array, constants: dict[str, Constant]) -> list[Pair]:
    """Pairs with at least one constant of the array that move together."""
    return [
        Pair(one, other, float(correlation[i, j]), advice.to_part(one, other))
        for i, one in enumerate(names)
        for j, other in enumerate(names[:i])
        if abs(correlation[i, j]) > INSEPARABLE and {one, other} & constants.keys()
    ]


def _shares(constants: dict[str, Constant], turn: Number | None, C_bu: Array) -> dict[str, float]:
    """What is left of each prior sigma.

    Where a bearing offset is estimated it is judged together with the mounting about the array's
    axis: each alone stays unknown however the vehicle moves.
    """
    judged = {name: (c.sigma, c.prior) for name, c in constants.items()}
    if turn is not None and "bearing_offset_deg" in judged:
        variance = judged.pop("bearing_offset_deg")[1] ** 2
        for name, share in zip(_MOUNTING, C_bu[:, 2], strict=True):
            if name in constants:
                variance += (share * constants[name].prior) ** 2
            if abs(share) > np.sqrt(0.5):
                judged.pop(name, None)
        judged["bearing_turn_deg"] = turn.sigma, float(np.sqrt(variance))
    return {name: sigma / prior for name, (sigma, prior) in judged.items() if prior > 0.0}


def _explained(name: str, share: float, names: list[str], correlation: Array) -> Unseen:
    """An unseen constant with what it is most easily taken for."""
    if name not in names:
        return Unseen(name, share, None, advice.to_see(name))
    row = np.abs(correlation[names.index(name)])
    row[names.index(name)] = 0.0
    partner = names[int(row.argmax())]
    if row.max() < PARTNER:
        return Unseen(name, share, None, advice.to_see(name))
    return Unseen(name, share, partner, advice.to_part(name, partner))


def _fit(rows: Residuals) -> Fit:
    def rms(numbers: Array) -> float:
        return float(np.sqrt(np.mean(numbers**2)))

    return Fit(
        count=len(rows.after),
        before_mean=float(rows.before.mean()),
        before_rms=rms(rows.before),
        after_mean=float(rows.after.mean()),
        after_rms=rms(rows.after),
        sigma=float(np.median(rows.sigma)),
    )


def array_block(source: Source, findings: Findings) -> UsblDevice:
    """The configuration block of the array that was calibrated."""
    return source.config.usbl[findings.device]
