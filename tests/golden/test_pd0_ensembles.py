"""Ensembles of a real ship's Doppler log, in the shared vectors, decode to how the ship moved."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest

from drivers import registry
from drivers.records import DvlRecord
from tests.shared_data import shared


def test_ocean_surveyor_under_way() -> None:
    lines = shared("vectors", "dvl", "pd0_ocean_surveyor.hex").read_text().split()
    said = json.loads(shared("vectors", "dvl", "pd0_ocean_surveyor.json").read_text())["decoded"]
    codec = registry.lookup("pd0")
    reader = codec.decoder(codec.options())
    for line, values in zip(lines, said, strict=True):
        (record,) = reader.feed(bytes.fromhex(line), 0)
        assert isinstance(record, DvlRecord)
        port, starboard, ahead, astern = values["beam_velocity_mm_s"]
        s, c = 2.0 * np.sin(np.pi / 6), 4.0 * np.cos(np.pi / 6)
        total = port + starboard + ahead + astern
        wanted = np.array([(ahead - astern) / s, (starboard - port) / s, total / c]) * 1e-3
        np.testing.assert_allclose(record.velocity_m_s, wanted, atol=1e-9)
        assert record.altitude_m == pytest.approx(np.mean(values["range_cm"]) / 100)
        year, *clock, hundredths = values["rtc"]
        when = datetime(2000 + year, *clock, 10_000 * hundredths, tzinfo=UTC)
        assert record.t_device_s == pytest.approx(when.timestamp(), abs=1e-3)
        assert record.sound_speed_m_s == values["sound_speed_m_s"]
    ahead, starboard, down = record.velocity_m_s
    assert ahead > 5.0
    assert abs(starboard) < 0.1 and abs(down) < 0.1
