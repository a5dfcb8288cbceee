"""The campaign's figures: by codec, by fault, over all."""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from tests.campaign.mission import DeviceRow, Result

BEYOND = 3.0
WORST = 5.0
"""An error of more sigma is a finding: chance makes one in fifty campaigns of 500."""

HEAD = (
    f"{'':16}{'missions':>9}{'made':>10}{'sent':>10}{'decoded':>10}{'rejected':>9}{'beside':>7}"
    f"{'taken':>6}{'lost':>8}{'reported':>9}{'axis>3s':>8}{'worst':>6}"
    f"{'pos>3s':>8}{'worst':>6}{'again':>6}{'x real':>7}"
)


def lines(results: list[Result]) -> Iterator[str]:
    """The table."""
    for device in sorted({name for r in results for name in r.devices}, key=_DEVICES.index):
        yield f"{device}, by codec"
        yield HEAD
        have = [r for r in results if device in r.devices]
        for codec in sorted({r.devices[device].codec for r in have}):
            yield _line(codec, [r for r in have if r.devices[device].codec == codec], [device])
        yield ""
    yield "all devices, by fault (a mission counts for each of its faults)"
    yield HEAD
    for kind in ("none", *sorted({kind for r in results for kind in r.kinds})):
        yield _line(kind, [r for r in results if kind in (r.kinds or ("none",))])
    yield ""
    yield "filter"
    yield HEAD
    for error in sorted({r.error for r in results}):
        yield _line(error, [r for r in results if r.error == error])
    yield _line("all", results)


_DEVICES = ("imu0", "usbl0", "lbl0", "gnss0", "depth0", "dvl0", "heading0")


def _line(title: str, results: list[Result], devices: Iterable[str] = _DEVICES) -> str:
    rows = [r.devices[device] for r in results for device in devices if device in r.devices]

    def total(of: Callable[[DeviceRow], int]) -> int:
        return sum(map(of, rows))

    return (
        f"{title:16}{len(results):9}{total(_made):10}{total(_sent):10}"
        f"{total(lambda row: row.verdict.decoded):10}{total(lambda row: row.rejected):9}"
        f"{total(lambda row: row.verdict.beside):7}{total(lambda row: row.verdict.taken):6}"
        f"{total(lambda row: row.sent.dropped):8}{total(lambda row: row.missing):9}"
        f"{100 * share(r.by_axis for r in results):7.2f}%"
        f"{max((r.worst for r in results), default=0.0):6.2f}"
        f"{100 * share(r.whole for r in results):7.2f}%"
        f"{max((r.whole.max(initial=0.0) for r in results), default=0.0):6.2f}"
        f"{sum(r.realignments for r in results):6}"
        f"{sum(r.mission_s for r in results) / max(1e-9, sum(r.took_s for r in results)):7.0f}"
    )


def findings(result: Result) -> list[str]:
    """What must not be."""
    if result.worst > WORST:
        return [*result.faults, f"an error of {result.worst:.1f} sigma"]
    return result.faults


def share(errors: Iterable[NDArray[np.float64]]) -> float:
    """Part of all errors that is beyond three of their sigma."""
    every = np.concatenate([np.empty(0), *(e.ravel() for e in errors)])
    return float((every > BEYOND).mean()) if every.size else 0.0


def _made(row: DeviceRow) -> int:
    return row.sent.frames + row.sent.damaged + row.sent.dropped


def _sent(row: DeviceRow) -> int:
    return row.sent.frames + row.sent.damaged + row.sent.repeated
