"""Seconds that begin with a pulse: sentences of a receiver through the real intake, with edges."""

import numpy as np
import pytest

from drivers import registry
from drivers.records import GnssRecord
from gateway.config import GnssDevice
from gateway.ingest import Intake
from tests.gateway.device_clocks import device

T0_S = 7000.0
DRIFT = 50e-6
MIDNIGHT = 86_400.0


def receiver(latency_ms: float) -> Intake:
    clock = {"source": "pps", "pulses": "/sys/class/pps/pps0/assert", "latency_ms": latency_ms}
    link = {"type": "serial", "port": "/dev/ttyS0", "baud": 9600}
    noise = {"position_m": [1.5, 1.5, 3.0], "velocity_m_s": 0.1}
    data = {"kind": "gnss", "codec": "nmea-gnss", "link": link, "clock": clock, "noise": noise}
    return Intake({"gnss0": device(GnssDevice, data)})


def gga(t_s: float) -> bytes:
    fields = {"lat_deg": 60.0, "lon_deg": 5.0, "height_m": 40.0, "quality": 1}
    record = GnssRecord(t_rx_ns=0, sentence="GGA", valid=True, t_device_s=t_s % MIDNIGHT, **fields)
    codec = registry.lookup("nmea-gnss")
    return codec.encode(record, device(codec.options, {}))


def heard(latency_ms, late_s, *, pulses, seconds=60, period_s=0.5):
    """Errors (s) of fixes whose sentences leave `late_s` after their epoch, and the intake."""
    rng = np.random.default_rng(1)
    intake = receiver(latency_ms)
    epochs = np.arange(0.0, seconds, period_s)
    true_s = T0_S + epochs * (1.0 + DRIFT)
    for epoch, t_s in zip(epochs, true_s, strict=True):
        if epoch % 1.0 == 0.0 and epoch < pulses:
            intake.pulse(round(1e9 * (t_s + 20e-6 * rng.exponential())))
        line = gga(MIDNIGHT - 30.0 + epoch)
        arrival_s = t_s + late_s + 5e-3 * rng.exponential() + len(line) * 10.0 / 9600
        intake.feed(line, round(1e9 * arrival_s))
    return np.array([fix.t_ns * 1e-9 for fix in intake.flush()]) - true_s, intake


@pytest.mark.parametrize(("latency_ms", "late_s"), [(80.0, 0.08), (0.0, 0.35), (80.0, 0.05)])
def test_with_pulses_no_latency_matters(latency_ms, late_s):
    """Declared, not declared, or too long: by tens of microseconds, over midnight."""
    error, intake = heard(latency_ms, late_s, pulses=np.inf)
    assert np.abs(error[20:]).max() < 100e-6
    assert np.sqrt(np.mean(error[60:] ** 2)) < 20e-6
    report = intake.clock_report()
    assert (report.source, report.state, report.resets) == ("pulse", "locked", 0)
    assert report.drift_ppm == pytest.approx(1e6 * DRIFT, abs=2.0)
    assert report.sigma_ms < 0.02


def test_where_pulses_stop_the_time_in_the_sentences_goes_on():
    error, intake = heard(80.0, 0.08, pulses=30.0)
    assert np.abs(error[20:75]).max() < 100e-6  # ten seconds more the pulses are relied on
    assert np.abs(error[90:]).max() < 5e-3
    assert intake.clock_report().source == "time"


def test_pulses_before_any_sentence_say_nothing():
    intake = receiver(80.0)
    intake.pulse(round(1e9 * T0_S))
    assert intake.clock_report().state == "silent"


def test_by_arrival_a_pulse_is_of_no_use():
    noise = {"position_m": [1.5, 1.5, 3.0], "velocity_m_s": 0.1}
    link = {"type": "udp", "port": 7003}
    data = {"kind": "gnss", "codec": "nmea-gnss", "link": link, "noise": noise}
    intake = Intake({"gnss0": device(GnssDevice, data)})
    intake.pulse(round(1e9 * T0_S))
    assert intake.clock_report().source == "arrival"
