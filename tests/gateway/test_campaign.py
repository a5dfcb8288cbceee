"""A few short missions of the campaign, and that it would see what it looks for."""

from dataclasses import replace

import numpy as np
import pytest

from drivers import registry
from drivers.records import Rejected
from gateway.emulator.instruments import emissions
from gateway.emulator.trajectory import Trajectory
from tests.campaign import mission
from tests.campaign.draw import IMUS, USBLS
from tests.campaign.draw import mission as drawn
from tests.campaign.table import findings, lines
from tests.campaign.watch import Units, WatchedDecoder, judge
from tests.gateway.emulated import demo_data, make

SECONDS = 45.0
EVERY_DAMAGE = [
    {"fault": fault, "device": device, "at_s": 10.0, "for_s": 30.0, "probability": 0.1}
    for fault in ("flip", "truncate", "junk", "duplicate", "reorder", "drop")
    for device in ("imu0", "usbl0")
]


def test_every_codec_is_drawn():
    codecs = [registry.lookup(name) for name in registry.CODECS]
    assert {c.name for c in codecs if c.kind == "imu"} == set(IMUS)
    assert {c.name for c in codecs if c.kind == "usbl"} == set(USBLS)
    wide = {d["codec"] for n in range(40) for d in drawn(1, n, wide=True)[0]["devices"].values()}
    assert {c.name for c in codecs if c.kind != "any"} == wide


def test_a_wide_mission_is_the_ordinary_one_and_more():
    for number in range(12):
        plain, wide = drawn(1, number)[0], drawn(1, number, wide=True)[0]
        assert plain["devices"].items() < wide["devices"].items()
        faults = len(plain["faults"])
        assert plain["faults"] == wide["faults"][:faults]
        assert {k: wide[k] for k in plain if k not in ("devices", "faults")} == {
            k: plain[k] for k in plain if k not in ("devices", "faults")
        }


@pytest.mark.parametrize("number", [4, 5, 11])
def test_a_mission_full_of_damage_accounts_for_every_byte(number):
    data, error = drawn(5, number, SECONDS)
    data["devices"]["imu0"]["rate_hz"] = 100.0
    data |= {"faults": EVERY_DAMAGE, "duration_s": SECONDS}
    result = mission.run(number, data, error)
    assert findings(result) == []
    sent = result.devices["imu0"].sent
    assert min(sent.damaged, sent.dropped, sent.repeated, sent.junk_bytes) > 0
    assert len(result.error_m) > 20
    assert any(line.startswith("all ") for line in lines([result]))


def test_a_wide_mission_full_of_damage_accounts_for_every_byte():
    data, error = drawn(5, 31, SECONDS, wide=True)
    data["devices"]["imu0"]["rate_hz"] = 100.0
    others = data["devices"].keys() - {"imu0", "usbl0"}
    assert others == {"lbl0", "gnss0", "dvl0"}
    damage = {"at_s": 5.0, "for_s": 15.0, "probability": 0.2}
    faults = [
        {"fault": fault, "device": device} | damage
        for fault in ("flip", "truncate", "junk", "duplicate", "reorder", "drop")
        for device in sorted(others)
    ]
    result = mission.run(31, data | {"faults": faults, "duration_s": 20.0}, error)
    assert findings(result) == []
    for name in others:
        row = result.devices[name]
        assert row.verdict.decoded > 0
        assert row.sent.damaged + row.sent.dropped + row.sent.junk_bytes > 0
    assert sum(line.endswith("by codec") for line in lines([result])) == 5


def test_a_mission_is_the_same_again_and_far_errors_are_findings():
    data, error = drawn(5, 0, SECONDS)
    data |= {"faults": EVERY_DAMAGE, "duration_s": 20.0}
    result, again = (mission.run(0, data, error) for _ in range(2))
    np.testing.assert_array_equal(result.error_m, again.error_m)
    assert result.devices == again.devices
    assert findings(result) == []
    wrong = replace(result, error_m=result.sd_m * [0.0, 5.1, 0.0])
    assert len(findings(wrong)) == 1


class Forgetful:
    """A decoder that keeps the tenth of its rejections to itself."""

    def __init__(self, decoder):
        self._decoder, self._rejected = decoder, 0

    def feed(self, data, t_rx_ns):
        for record in self._decoder.feed(data, t_rx_ns):
            self._rejected += isinstance(record, Rejected)
            if self._rejected != 10:
                yield record

    def close(self):
        return self._decoder.close()


@pytest.mark.parametrize("forgets", [False, True])
def test_bytes_that_nobody_tells_of_are_found(forgets):
    flips = {"fault": "flip", "device": "imu0", "at_s": 0.0, "for_s": 3.0, "probability": 0.2}
    data = demo_data() | {"duration_s": 3.0, "faults": [flips]}
    data["devices"] = {"imu0": data["devices"]["imu0"]}
    scenario = make(data)
    codec = registry.lookup("kvh1750")
    made: list[object] = []

    def fresh():
        """The decoder under test, then those that judge it."""
        decoder = codec.decoder(codec.options(accel="g"))
        made.append(decoder)
        return Forgetful(decoder) if forgets and len(made) == 1 else decoder

    watched = WatchedDecoder(fresh)
    units = Units()
    for k, e in enumerate(emissions(scenario, Trajectory(scenario.trajectory, 3.0), 0.0, 1.0)):
        units.note(e)
        list(watched.feed(e.data, k))
    list(watched.close())
    verdict = judge("imu0", units, watched)
    assert bool(verdict.faults) is forgets
    assert verdict.made == 600
