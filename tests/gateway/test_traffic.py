"""Recordings as what a replay is made from: the same bytes, begun where the live run began."""

import itertools
from pathlib import Path

import msgspec
import pytest
import yaml

from drivers.capture.streams import Payload, read_streams
from gateway import replay
from gateway.clock.utc import UtcSample
from gateway.config import Config, load
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.errors import ConfigError, UsblnavError
from gateway.estimator import Estimator
from gateway.ingest import intakes
from gateway.messages import NavSolution, SavedState
from gateway.outputs.files import ReplayFiles
from gateway.outputs.schema import nav_report
from gateway.recording.events import Event, Orders, Pulse, Raw, Run
from gateway.recording.writer import Tape
from gateway.replay.traffic import open_traffic
from gateway.resume import COLD, Resume
from tests.gateway.emulated import START, demo_data, make
from tests.gateway.recorded import batches, files, orders

OFFSET_NS = 77_000_000_000


class Voyage:
    """A short capture, its configuration, and its chunks as the daemon would take them."""

    def __init__(self, folder: Path) -> None:
        self.capture, self.file = folder / "sea.pcap", folder / "sea.yaml"
        data = demo_data() | {"duration_s": 16.0, "start": START}
        data["devices"]["imu0"]["options"]["format"] = "b"  # it tells its own time
        data["devices"]["usbl0"] |= {"period_s": 1.0}
        scenario = twin.for_capture(make(data))
        emulate(scenario, pcap=self.capture, say=lambda _line: None)
        self.file.write_text(yaml.safe_dump(twin.gateway_config(scenario)))
        self.config: Config = load(self.file)
        links = {name: device.link for name, device in self.config.devices.items()}
        self.chunks = [Raw(p.device, p.t_rx_ns, p.data, p.source) for p in self._read(links)]

    def _read(self, links: dict) -> list[Payload]:
        return list(read_streams([self.capture], links))

    def record(self, folder: Path, events: list[Event], resume: Resume = COLD) -> None:
        """Write a recording as the writer does."""
        plain = orders(folder)
        run = Run("run", "usblnav 1.2.3", 5.0, self.config, resume)
        tape = Tape(Orders(run, plain.settings, plain.schemas))
        for batch in batches(events, 100):
            tape.take(batch)
        tape.close()


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Voyage:
    return Voyage(tmp_path_factory.mktemp("voyage"))


def utc(chunk: Raw, offset_ns: int = OFFSET_NS) -> UtcSample:
    return UtcSample(chunk.t_rx_ns, offset_ns)


def test_a_recording_of_captured_bytes_is_replayed_like_the_capture(
    voyage: Voyage, tmp_path: Path
) -> None:
    voyage.record(tmp_path, [utc(voyage.chunks[0], 0), *voyage.chunks])
    replay.run([voyage.capture], voyage.config, out=tmp_path / "capture", rate_hz=5.0)
    summary = replay.run(files(tmp_path), None, out=tmp_path / "recording")
    for name in ("nav.csv", "innovations.csv", "calibration.csv", "residuals.csv"):
        captured = (tmp_path / "capture" / name).read_bytes()
        assert (tmp_path / "recording" / name).read_bytes() == captured
    assert summary["recording"]["chunks"] == {"selected": len(voyage.chunks), "not_selected": 0}
    assert summary["duration_s"] == pytest.approx(16.0, abs=0.6)


def test_times_are_those_of_the_samples_in_force(voyage: Voyage, tmp_path: Path) -> None:
    half = len(voyage.chunks) // 2
    stepped = utc(voyage.chunks[half], OFFSET_NS + 3_000_000_000)
    first = voyage.chunks[0]
    voyage.record(tmp_path, [utc(first), *voyage.chunks[:half], stepped, *voyage.chunks[half:]])
    replay.run(files(tmp_path), None, out=tmp_path / "out")
    rows = (tmp_path / "out" / "nav.csv").read_text().splitlines()[1:]
    times = [float(row.split(",")[0]) for row in rows]
    steps = [b - a for a, b in itertools.pairwise(times)]
    assert max(steps) == pytest.approx(3.2, abs=0.02)
    assert sum(step > 0.3 for step in steps) == 1


def test_a_run_that_went_on_from_a_state_is_replayed_from_it(
    voyage: Voyage, tmp_path: Path
) -> None:
    """From its filter's state, and with its clocks: the first had locked after eight seconds."""
    cut = 5 * len(voyage.chunks) // 8
    _, resume = run(voyage, COLD, voyage.chunks[:cut])
    rest = voyage.chunks[cut:]
    voyage.record(tmp_path, [utc(rest[0]), *rest], resume)
    for name, known in (("live", resume), ("clockless", Resume(resume.state))):
        with ReplayFiles(tmp_path / name) as files_of_it:
            for output in run(voyage, known, rest)[0]:
                if isinstance(output, NavSolution):
                    files_of_it.nav(nav_report(output, OFFSET_NS))
    replay.run(files(tmp_path), None, out=tmp_path / "again")
    replay.run(files(tmp_path), voyage.config, out=tmp_path / "cold")
    nav = (tmp_path / "live" / "nav.csv").read_bytes()
    assert len(nav.splitlines()) > 25
    assert (tmp_path / "again" / "nav.csv").read_bytes() == nav
    assert (tmp_path / "clockless" / "nav.csv").read_bytes() != nav
    assert (tmp_path / "cold" / "nav.csv").read_bytes() != nav
    replay.run(files(tmp_path), None, out=tmp_path / "smooth", smooth=True)
    smooth = (tmp_path / "smooth" / "nav.csv").read_bytes()
    assert len(smooth.splitlines()) == len(nav.splitlines())


def run(voyage: Voyage, resume: Resume, chunks: list[Raw]) -> tuple[list, Resume]:
    """As the daemon and its worker do it; what they say, and from where others may go on."""
    devices = intakes(voyage.config, resume.clocks)
    estimator = Estimator(voyage.config, 5.0, resume.state)
    said = []
    for chunk in chunks:
        devices[chunk.device].feed(chunk.data, chunk.t_rx_ns, chunk.source)
        for measurement in devices[chunk.device].flush():
            said += estimator.feed(measurement)
    state = [output for output in said if isinstance(output, SavedState)][-1]
    return said, Resume(state, devices["imu0"].clock_memory())


def test_a_later_file_by_itself_begins_at_the_state_of_its_beginning(
    voyage: Voyage, tmp_path: Path
) -> None:
    _, newest = run(voyage, COLD, voyage.chunks[: 5 * len(voyage.chunks) // 8])
    assert newest.clocks["imu0"]["time"].placed is not None
    tape = Tape(orders(tmp_path))
    first, *later = batches([utc(voyage.chunks[0]), *voyage.chunks[:40]], 10)
    tape.take(msgspec.structs.replace(first, resume=newest))
    tape.close()
    for batch in later:
        tape.take(batch)
    tape.close()
    one, two = files(tmp_path)
    assert open_traffic([one], None, None).resume == COLD
    assert open_traffic([two], None, None).resume == newest
    assert open_traffic([two, one], None, None).resume == COLD


def test_pulses_come_where_they_came(voyage: Voyage, tmp_path: Path) -> None:
    a, b, c, *_ = voyage.chunks
    pulse, strange = Pulse("usbl0", b.t_rx_ns), Pulse("gnss7", b.t_rx_ns)
    voyage.record(tmp_path, [utc(a), a, pulse, strange, b, c])
    found = [item if isinstance(item, Pulse) else "chunk" for item in traffic(tmp_path)]
    assert found == ["chunk", pulse, "chunk", "chunk"]


def traffic(folder: Path) -> list:
    return list(open_traffic(files(folder), None, None))


def test_what_cannot_be_replayed_is_one_line(voyage: Voyage, tmp_path: Path) -> None:
    voyage.record(tmp_path, [utc(voyage.chunks[0])])
    with pytest.raises(ConfigError, match="-c: missing; only a recording holds its configuration"):
        open_traffic([voyage.capture], None, None)
    with pytest.raises(ConfigError, match="cannot be replayed together"):
        open_traffic([voyage.capture, *files(tmp_path)], None, None)
    with pytest.raises(UsblnavError, match=r"no bytes for any device .* \(1 events read\)"):
        replay.run(files(tmp_path), None, out=tmp_path / "out")
