"""The start: samples are gathered until they give the attitude, then the filter runs over them.

It runs from the window's beginning, not from its end: the configured position and velocity are
those of the first samples, and the fixes heard meanwhile count in their places.
"""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from gateway.config import Config
from gateway.fusion import align
from gateway.fusion.course_heading import heading_by_course
from gateway.fusion.initial import (
    ANY_HEADING_SD_DEG,
    attitude_deg,
    initial_state,
    model,
    noise_densities,
)
from gateway.fusion.restart import forget
from gateway.fusion.sighting_heading import agreed, seen_heading
from gateway.fusion.state import ATT, BA, BG, VEL, State
from gateway.fusion.window import attitudes
from gateway.messages import Aligning, Component, Fix, ImuBlock, Innovation, VelocityFix
from gateway.nav import strapdown as sd
from gateway.nav.attitude import euler_from_C
from gateway.nav.earth import C_en, ecef_to_lla

Array = NDArray[np.float64]
Times = NDArray[np.int64]

MOST_SAMPLES, MOST_FIXES = 2400, 500
"""What a new process is told at most of an alignment under way."""

_BIASES = slice(9, 15)


class Start:
    """Finds the first state of one vehicle from its first samples (``initial.align``).

    A window whose motion leaves the attitude too uncertain is refused and the next one tried.

    Parameters
    ----------
    prior
        What is known but for the attitude, at the first sample: a state taken up again. Without it,
        what the configuration says; with it, a heading of the configuration is out of date and is
        found like one that is unknown.

    Attributes
    ----------
    state
        At the beginning of the window that gave the attitude; None while there is none.
    fixes
        What came meanwhile, in the order of arrival.
    """

    def __init__(self, config: Config, prior: State | None = None) -> None:
        assert config.initial.align is not None
        self.state: State | None = None
        self.fixes: list[Fix] = []
        self._choice = config.initial.align
        self._device, imu = config.imu
        self._prior = initial_state(config) if prior is None else prior
        self._model = model(config)
        self._site = _site(self._prior)
        q = np.sqrt(noise_densities(imu.noise))
        biases = [math.sqrt(np.trace(self._prior.P[b, b]) / 3.0) for b in (BG, BA)]
        self._grade = align.Grade(float(q[0]), float(q[1]), *biases)
        self._heading_is_known = self._choice.heading == "config" and prior is None
        self._heading, self._heading_sd = (math.radians(a[2]) for a in attitude_deg(config.initial))
        if not self._heading_is_known:
            self._heading, self._heading_sd = 0.0, math.radians(ANY_HEADING_SD_DEG)
        self._span_ns = round(1e9 * self._choice.window_s)
        self._t: list[Times] = []
        self._rows: list[Array] = []
        self._t_first_ns: int | None = None
        self._again = prior is not None

    @property
    def memory(self) -> Aligning | None:
        """What a new process goes on from; None while that is too much to be told.

        It is little each time a window has just begun.
        """
        held = sum(map(len, self._t))
        if self._t_first_ns is None or held > MOST_SAMPLES or len(self.fixes) > MOST_FIXES:
            return None
        t_ns, rows = (b"".join(part.tobytes() for part in kept) for kept in (self._t, self._rows))
        return Aligning(self._again, self._t_first_ns, ImuBlock(t_ns, rows))

    def go_on(self, at: Aligning, fixes: Iterable[Fix]) -> None:
        """Take over from an earlier process."""
        self._t_first_ns, self.fixes = at.t_first_ns, list(fixes)
        if at.samples.t_ns:
            self._t = [np.frombuffer(at.samples.t_ns, dtype=np.int64)]
            self._rows = [np.frombuffer(at.samples.rows).reshape(-1, 8)]

    def take(self, t_ns: Times, rows: Array) -> Iterator[Innovation]:
        """Take samples; give a verdict on each window they complete, until one is good."""
        if not len(t_ns):
            return
        self._t.append(t_ns)
        self._rows.append(rows)
        if self._t_first_ns is None:
            self._t_first_ns = self._begins()
        while self.state is None and self._t and self._t[-1][-1] >= self._begins() + self._span_ns:
            t, held = self.samples
            count = int(np.searchsorted(t, self._begins() + self._span_ns)) + 1
            verdict, found = self._judge(t[:count], held[:count])
            yield verdict
            if verdict.accepted:
                self.state = self._first_state(found)
            else:
                self._t = [t[count:]] if count < len(t) else []
                self._rows = [held[count:]] if count < len(t) else []
                yield from self._forget(int(t[count - 1]))

    @property
    def samples(self) -> tuple[Times, Array]:
        """(n,) and (n, 8): what was taken since the window's beginning, beyond its end too."""
        self._t, self._rows = [np.concatenate(self._t)], [np.concatenate(self._rows)]
        return self._t[0], self._rows[0]

    def waiting(self, t_ns: int) -> State:
        """What is known without an attitude: the place and velocity before, some time unseen."""
        state = self._prior.copy()
        if self._t_first_ns is not None:
            forget(state.x, state.P, max(0.0, (t_ns - self._t_first_ns) * 1e-9))
        return state

    def _begins(self) -> int:
        """Beginning of the first sample's interval."""
        return int(self._t[0][0]) - round(float(self._rows[0][0, 0]) * 1e9)

    def _judge(self, t_ns: Times, rows: Array) -> tuple[Innovation, align.Found]:
        """What a window gives, and whether that will do."""
        found, missing = self._find(t_ns, self._unbiased(rows))
        reason = missing or found.refusal
        roll, pitch, heading = np.degrees(euler_from_C(found.C_nb))
        level_sd, heading_sd = np.degrees([found.level_sd, found.heading_sd])
        components = (
            Component("roll_deg", float(roll), float(level_sd)),
            Component("pitch_deg", float(pitch), float(level_sd)),
            Component("heading_deg", float(heading) % 360.0, float(heading_sd)),
        )
        t_begin, nan = self._begins(), float("nan")
        return Innovation(t_begin, self._device, "", components, nan, not reason, reason), found

    def _unbiased(self, rows: Array) -> Array:
        """Samples without the biases that are known."""
        rows = rows.copy()
        rows[:, 1:7] -= rows[:, :1] * self._prior.x[sd.B_G.start : sd.B_A.stop]
        return rows

    def _find(self, t_ns: Times, rows: Array) -> tuple[align.Found, str]:
        """Attitude of a window, and what its heading lacks."""
        if self._choice.heading == "gyrocompass":
            return align.gyrocompass(rows, self._site, self._grade), ""
        found = self._level(rows, self._heading, self._heading_sd)
        if self._heading_is_known or found.refusal:
            return found, ""
        if self._choice.heading == "gnss_course":
            return self._on_course(t_ns, rows, found)
        if not self._model.arrays:
            return found, ""
        seen = self._seen(t_ns, rows, found)
        if seen is None:
            return found, "no_fix"
        return self._level(rows, seen, self._heading_sd), ""

    def _level(self, rows: Array, heading: float, heading_sd: float) -> align.Found:
        """Level of a window begun on a heading."""
        return align.level(rows, self._site, self._grade, heading, heading_sd)

    def _on_course(self, t_ns: Times, rows: Array, found: align.Found) -> tuple[align.Found, str]:
        """Level with the heading by the velocities in the window."""
        fixes = [fix for fix in self._within(t_ns) if isinstance(fix, VelocityFix)]
        if not fixes:
            return found, "no_course"
        at = np.searchsorted(t_ns, [fix.t_ns for fix in fixes])
        turned = np.concatenate([np.eye(3)[None], attitudes(rows)[at]])
        levers = np.array([self._model.mount(fix.device).lever_b for fix in fixes])
        v_arm_b = np.cross(rows[at, 1:4] / rows[at, :1], levers)
        sway_v = math.hypot(*found.sway_v[:2]) / math.sqrt(2.0)
        crab = math.radians(self._choice.crab_deg)
        for known in (0.0, 1.0):  # where the antenna swings to shows only once the heading does
            C_nb = found.C_nb @ turned
            v_arm_n = known * np.einsum("nij,nj->ni", C_nb[1:], v_arm_b)
            heading, sd = heading_by_course(fixes, C_nb, v_arm_n, sway_v, crab)
            if not math.isfinite(sd):
                return found, "too_slow"
            found = self._level(rows, heading, sd)
        return found, ""

    def _within(self, t_ns: Times) -> list[Fix]:
        """The fixes heard of a window's time."""
        return [fix for fix in self.fixes if self._begins() < fix.t_ns <= t_ns[-1]]

    def _seen(self, t_ns: Times, rows: Array, found: align.Found) -> float | None:
        """Heading at the window's beginning by the fixes in it, if there are any.

        It says about which heading the first fixes are linearised; that they are used again for
        the state is no harm, because the heading's sigma stays that of one which may be any.
        """
        turned = attitudes(rows)
        seen = [
            seen_heading(
                fix,
                self._model,
                found.C_nb @ turned[np.searchsorted(t_ns, fix.t_ns)],
                self.waiting(fix.t_ns).r_e,
            )
            for fix in self._within(t_ns)
        ]
        known = [heading for heading in seen if heading is not None]
        return agreed(known) if known else None

    def _first_state(self, found: align.Found) -> State:
        """State at the window's beginning, its attitude error tied to the biases'.  # (M.133)"""
        state = self.waiting(self._begins())
        lat, lon, _ = ecef_to_lla(state.r_e)
        C, P = C_en(lat, lon), state.P
        state.x[sd.C_EB] = state.x[sd.CHAIN] = (C @ found.C_nb).ravel()
        J = C @ np.hstack([found.by_gyro, found.by_accel])
        P[ATT, :] = J @ P[_BIASES, :]
        P[:, ATT] = P[ATT, :].T
        P[ATT, ATT] = J @ P[_BIASES, _BIASES] @ J.T + C @ found.noise @ C.T
        P[VEL, VEL] += C @ np.diag(found.sway_v**2) @ C.T
        return state

    def _forget(self, t_ns: int) -> Iterator[Innovation]:
        """Refuse the fixes of a window that gave no attitude."""
        stale = [fix for fix in self.fixes if fix.t_ns <= t_ns]
        self.fixes = [fix for fix in self.fixes if fix.t_ns > t_ns]
        for fix in sorted(stale, key=lambda fix: fix.t_ns):
            beacon = getattr(fix, "beacon", "")
            yield Innovation(fix.t_ns, fix.device, beacon, (), float("nan"), False, "aligning")


def _site(prior: State) -> align.Site:
    """Place and mean velocity of the vehicle while it aligns."""
    lat, lon, h = (float(v) for v in ecef_to_lla(prior.r_e))
    sigma_v = math.sqrt(float(np.trace(prior.P[VEL, VEL])) / 3.0)
    return align.Site(lat, h, C_en(lat, lon).T @ prior.v_eb_e, sigma_v)
