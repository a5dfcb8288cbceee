"""A moment of an estimator as a message, from which the estimator of a new process goes on."""

from dataclasses import dataclass

from gateway.fusion.saved import saved
from gateway.handover import Note
from gateway.messages import Aligning, Checkpoint, Second, Vec3


@dataclass(frozen=True)
class Totals:
    """What stands beside a note of the timeline in a checkpoint."""

    note: Note
    received: int
    said: int
    imu_samples: int
    seconds: tuple[Second, ...]
    is_credible: bool


def checkpoint(
    at: Totals, origin_e: Vec3, resets: int, aligning: Aligning | None = None
) -> Checkpoint:
    """What a new process needs to go on from a settled note, or from within an alignment."""
    note = at.note
    return Checkpoint(
        state=saved(note.state, note.t_ns),
        received=at.received,
        said=at.said + note.told,
        began_ns=note.began_ns,
        origin_e=origin_e,
        fixes=tuple(fix for _, _, fix in note.known),
        past={t_ns: row.tobytes() for t_ns, row in note.past.items()},
        consumed=note.count,
        imu_samples=at.imu_samples,
        fixes_late=note.order.late,
        fixes_too_late=note.order.too_late,
        fixes_too_early=note.order.too_early,
        fixes_duplicate=note.order.duplicate,
        resets=resets,
        aligning=aligning,
        seconds=at.seconds,
        is_credible=at.is_credible,
    )
