"""When refused fixes are a reason to doubt the filter instead, and how it is freed."""

import numpy as np

from gateway.fusion.kalman import Linearised
from gateway.fusion.memory import Memory
from gateway.fusion.state import ATT, POS, VEL
from gateway.messages import BottomVelocity, Fix, VelocityFix

LOCK_OUT = 8
"""Fixes refused in a row after which the filter doubts itself, not the fixes."""
LOCK_OUT_S, RARE = 30.0, 4
"""And as many of them if nothing that locates was used for so long: where fixes come rarely."""
VELOCITY_LOCK_OUT_S = 30.0
"""The same for a device's velocities, as long as nothing that locates is used meanwhile."""
GROWN = 3.0
"""By how much more they are then off than the first that was refused."""
BEYOND_A_LOG = 3.0
"""And by how much at all (m/s): what a log may hear instead of the bottom is slower."""
FREED = 3
"""Fixes used in a row after which it trusts itself again."""
JUMP = ((ATT, 0.5), (VEL, 1.0), (POS, 9.0))
"""Variance that a refusal adds meanwhile to each part of the pose, relative to what it has.

Independent of everything else: scaled together with its correlations, an error in position would
be paid for by velocity, attitude and the instruments' constants.
"""


def is_locked_out(memory: Memory) -> bool:
    """Whether so many fixes were refused in a row that the filter is doubted."""
    return memory.refused_in_a_row > LOCK_OUT


def note_used(memory: Memory, fix: Fix) -> None:
    """Count a used fix, towards the end of a lock-out too."""
    memory.used += 1
    memory.aided = True
    if not fix.locates:
        return
    memory.t_used_ns = fix.t_ns
    memory.velocity_refused.clear()
    if is_locked_out(memory):
        memory.refused_in_a_row = min(memory.refused_in_a_row, LOCK_OUT + FREED) - 1
    if not is_locked_out(memory):
        memory.refused_in_a_row = 0


def note_refused(memory: Memory, fix: Fix, z: Linearised) -> None:
    """Count a refused fix and free a filter that is locked out.  # (M.37)

    Only what locates the vehicle tells of a lock-out: anything else agrees with a wrong place.
    """
    memory.gated += 1
    if isinstance(fix, BottomVelocity | VelocityFix):
        _doubt_velocity(memory, fix, float(np.linalg.norm(z.residual)))
    memory.refused_in_a_row += fix.locates
    if memory.refused_in_a_row >= RARE and _unused_s(memory, fix) > LOCK_OUT_S:
        memory.refused_in_a_row = max(memory.refused_in_a_row, LOCK_OUT + 1)
    if fix.locates and is_locked_out(memory):
        for part, share in JUMP:
            block = memory.state.P[part, part]
            block += share * np.trace(block) / 3.0 * np.eye(3)


def trusts_velocity_again(memory: Memory, fix: Fix) -> bool:
    """Count a used velocity towards the end of its lock-out; whether it was one."""
    refused = memory.velocity_refused.pop(fix.device, None)
    if refused is None or fix.t_ns - refused[0] <= VELOCITY_LOCK_OUT_S * 1e9:
        return False
    if refused[2] + 1 < FREED:
        memory.velocity_refused[fix.device] = (*refused[:2], refused[2] + 1)
    return True


def _doubt_velocity(memory: Memory, fix: Fix, off_m_s: float) -> None:
    """Free a filter that parts for long from what a device says.  # (M.166)

    A log that is wrong is as wrong after a while; a wrong attitude makes the way apart grow.
    """
    refused = memory.velocity_refused
    since_ns, first_m_s, _ = refused.get(fix.device, (fix.t_ns, off_m_s, 0))
    refused[fix.device] = since_ns, first_m_s, 0
    away_s = (fix.t_ns - since_ns) * 1e-9
    if away_s <= VELOCITY_LOCK_OUT_S or off_m_s < max(GROWN * first_m_s, BEYOND_A_LOG):
        return
    P = memory.state.P
    (_, turned), (_, gained), _ = JUMP
    P[ATT, ATT] += turned * np.trace(P[ATT, ATT]) / 3.0 * np.eye(3)
    doubt = gained * np.trace(P[VEL, VEL]) / 3.0 * np.eye(3)
    P[VEL, VEL] += doubt
    P[POS, VEL] += away_s / 2.0 * doubt
    P[VEL, POS] += away_s / 2.0 * doubt
    P[POS, POS] += away_s**2 / 3.0 * doubt


def _unused_s(memory: Memory, fix: Fix) -> float:
    """How long nothing was used that locates; 0 where nothing ever was."""
    return 0.0 if memory.t_used_ns is None else (fix.t_ns - memory.t_used_ns) * 1e-9
