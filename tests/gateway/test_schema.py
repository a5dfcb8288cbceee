"""Plain data to blocks: what the configuration file's own types do not exercise."""

from enum import Enum
from typing import Annotated, Any, Literal

import msgspec
import pytest
from msgspec import Meta

from gateway.schema import build, draft, known, shown


class Colour(Enum):
    RED = "red"
    GREEN = "green"


class Inner(msgspec.Struct, frozen=True, kw_only=True):
    x: Annotated[float, Meta(gt=0)]
    n: Annotated[int, Meta(multiple_of=2)] = 2


class Outer(msgspec.Struct, frozen=True, kw_only=True):
    inner: Inner | None = None
    colour: Colour = Colour.RED
    start: Annotated[float, Meta(ge=0)] | Literal["now"] = "now"
    on: bool = False
    items: list[Inner] = []
    by_name: dict[str, int] = {}
    by_number: dict[int, str] = {}
    anything: Any = None


def test_all_types_of_field() -> None:
    faults: list[str] = []
    data = {
        "inner": {"x": 3, "n": 4},
        "colour": "green",
        "start": 12,
        "on": True,
        "items": [{"x": 0.5}],
        "by_name": {1: 2},
        "by_number": {3: "c"},
        "anything": [{"deep": None}],
    }
    assert build(Outer, data, faults) == Outer(
        inner=Inner(x=3.0, n=4),
        colour=Colour.GREEN,
        start=12.0,
        on=True,
        items=[Inner(x=0.5)],
        by_name={"1": 2},
        by_number={3: "c"},
        anything=[{"deep": None}],
    )
    assert faults == []


def test_agrees_with_msgspec_on_good_data() -> None:
    data = {"inner": {"x": 2.5, "n": -6}, "start": "now", "items": [{"x": 1.0}, {"x": 2.0}]}
    assert build(Outer, data, []) == msgspec.convert(data, Outer)


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        ({"inner": {"x": float("inf")}}, "inner.x: expected a number > 0, got inf"),
        ({"inner": {"x": 10**400}}, f"inner.x: expected a number > 0, got {10**39}"),
        ({"items": [{"x": "1e-3"}]},
         'items[0].x: expected a number > 0, got "1e-3" (take away the quotes)'),
        ({"inner": {"x": 1, "n": 3}}, "inner.n: expected an integer in steps of 2, got 3"),
        ({"inner": {"x": 1, "n": 4.0}}, "inner.n: expected an integer in steps of 2, got 4.0"),
        ({"inner": [1]}, "inner: expected a block of keys, got a list"),
        ({"colour": "blue"}, 'colour: expected one of red, green, got "blue"'),
        ({"start": -1}, "start: expected a number >= 0 or now, got -1"),
        ({"start": "then"}, 'start: expected a number >= 0 or now, got "then"'),
        ({"on": "on"}, 'on: expected true or false, got "on"'),
        ({"on": 1}, "on: expected true or false, got 1"),
        ({"items": {"x": 1}}, "items: expected a list, got a block of keys"),
        ({"items": [{"x": 1}, {}]}, "items[1].x: missing"),
        ({"by_name": {"a b": True}}, "by_name.a b: expected an integer, got true"),
        ({"inner": {"x": 1, "l\nf": 2}}, 'inner."l\\nf": unknown key; one of: x, n'),
        ([], "expected a block of keys, got a list"),
        (None, "expected a block of keys, got nothing"),
    ],
)  # fmt: skip
def test_fault(data: Any, fault: str) -> None:
    faults: list[str] = []
    assert build(Outer, data, faults) is None
    assert faults == [fault]


def test_path_stands_before_every_fault() -> None:
    faults = ["found before"]
    assert build(Inner, {"x": 0, "y": 1}, faults, "devices.imu0.options") is None
    assert faults == [
        "found before",
        "devices.imu0.options.x: expected a number > 0, got 0",
        "devices.imu0.options.y: unknown key; one of: x, n",
    ]


def test_a_fault_before_does_not_spoil_the_value() -> None:
    assert build(Inner, {"x": 1}, ["found before"]) == Inner(x=1.0)


def test_draft_has_holes_where_faults_are() -> None:
    faults: list[str] = []
    value = draft(Outer, {"inner": {"x": -1, "n": 4}, "on": True}, faults)
    assert len(faults) == 1
    assert value.inner is not None
    assert not known(value.inner.x)
    assert known(value.inner.n, value.on)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("x" * 100, '"' + "x" * 57 + '..."'),
        ("bell\a", '"bell\\u0007"'),
        ("é", '"é"'),
        ("\ud800", '"\\ud800"'),
        (False, "false"),
        (1.50, "1.5"),
    ],
)
def test_shown_is_short_and_on_one_line(value: Any, text: str) -> None:
    assert shown(value) == text
