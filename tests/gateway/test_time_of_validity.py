"""Bytes of drifting instruments through the real intake: how well the times of validity are known.

The bars are 0.2 ms RMS for an IMU and 1 ms for sentences at 9600 baud, a minute after the start,
with a wrap, a power cycle and a step of NTP in the run; `python -m tests.bench.clocks` prints a
table over many seeds.
"""

import pytest

from tests.gateway.device_clocks import inertial, sentences

RUN = {"seconds": 120.0, "wrap_at": 65.0, "cycle_at": 80.0, "step_at": 100.0}


@pytest.mark.parametrize(
    ("source", "drift", "told"), [("device", 50e-6, "time"), ("arrival", -50e-6, "sequence")]
)
def test_an_imu_is_placed_to_a_fifth_of_a_millisecond(source, drift, told):
    """Its own microseconds, or nothing but the sequence number of its frames."""
    run = inertial(3, source=source, drift=drift, **RUN)
    assert run.rms_ms((80.0, 92.0)) < 0.2
    assert run.rms_ms((82.5, 120.0), since=82.0) < 10.0  # from the first frames of the power cycle
    report, counts = run.intake.clock_report(), run.intake.counts
    assert (report.source, report.state, report.resets) == (told, "locked", 1)
    assert report.drift_ppm == pytest.approx(1e6 * drift, abs=3.0)
    assert 1e3 * abs(run.error_s[-1]) < 4.0 * report.sigma_ms < 0.4
    assert counts.gaps == 1
    assert counts.missing == pytest.approx(400, abs=4)


@pytest.mark.parametrize("seed", range(4))
def test_sentences_with_a_time_are_placed_to_a_millisecond(seed):
    """Thirty of them in the first minute, each 5 ms late on the mean; midnight and a step ahead."""
    run = sentences(seed, drift=(-1) ** seed * 50e-6)
    assert run.rms_ms((119.0, 160.0)) < 1.0
    report = run.intake.clock_report()
    assert (report.source, report.state, report.resets) == ("time", "locked", 1)
    assert 1e3 * abs(run.error_s[-1]) < 4.0 * report.sigma_ms < 2.0
    assert report.untimed == 0


def test_by_its_arrival_alone_a_sentence_is_late_by_all_that_delayed_it():
    run = sentences(0, source="arrival")
    assert 5.0 < run.rms_ms() < 10.0
    report = run.intake.clock_report()
    assert (report.source, report.state, report.sigma_ms) == ("arrival", None, None)
