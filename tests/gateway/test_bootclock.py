"""How long ago a moment was, and when nobody can tell."""

import time
from pathlib import Path

import msgspec
import pytest

from gateway.machine.bootclock import Moment, now, unbelievable

S = 1_000_000_000
THEN = Moment("a", 100 * S, 1_780_000_000 * S, True)


def later(**changes: object) -> Moment:
    return msgspec.structs.replace(THEN, **changes)


def test_of_one_boot_the_monotonic_clock_tells_whatever_the_wall_clock_does() -> None:
    at = later(mono_ns=103 * S, utc_ns=0, is_sure=False)
    assert at.since(THEN) == 3 * S
    assert unbelievable(THEN, at) is None


def test_between_boots_the_wall_clock_tells() -> None:
    at = later(boot="b", mono_ns=5 * S, utc_ns=THEN.utc_ns + 40 * S)
    assert at.since(THEN) == 40 * S
    assert unbelievable(THEN, at) is None


@pytest.mark.parametrize(
    ("then", "at", "why"),
    [
        (THEN, later(mono_ns=99 * S), "future"),
        (THEN, later(boot="b", utc_ns=THEN.utc_ns - 1), "future"),
        (THEN, later(boot="b", utc_ns=THEN.utc_ns + S, is_sure=False), "no hardware clock"),
        (later(is_sure=False), later(boot="b", utc_ns=THEN.utc_ns + S), "no hardware clock"),
    ],
)
def test_a_clock_that_cannot_be_right_is_not_believed(then: Moment, at: Moment, why: str) -> None:
    assert why in (unbelievable(then, at) or "")


@pytest.mark.parametrize(
    ("off_s", "is_sure"), [(0.0, True), (3.0, True), (-60.0, False), (None, False)]
)
def test_a_hardware_clock_vouches_for_the_wall_clock(
    tmp_path: Path, off_s: float | None, is_sure: bool
) -> None:
    for name, text in (("rtc0", "no number"), ("rtc1", f"{int(time.time() + (off_s or 0))}\n")):
        (tmp_path / name).mkdir()
        if off_s is not None:
            (tmp_path / name / "since_epoch").write_text(text)
    assert now(hardware=tmp_path).is_sure is is_sure


def test_the_boot_is_the_same_for_all_and_its_own_where_it_has_no_name(tmp_path: Path) -> None:
    assert now().boot == now().boot != ""
    nameless = now(boot_id=tmp_path / "none"), now(boot_id=tmp_path / "none")
    assert nameless[0].boot != nameless[1].boot
