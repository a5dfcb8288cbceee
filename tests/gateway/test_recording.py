"""Recordings as files: what is in them, when the next begins, and which go."""

import json
from pathlib import Path
from random import Random

import msgspec
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from drivers.capture.files import CaptureError
from drivers.imu.kvh import KVH1750, KvhOptions
from drivers.records import ImuRecord
from gateway.errors import ConfigError
from gateway.recording.events import Event, LineEvent, Raw, Report
from gateway.recording.reader import RecordedRun, is_recording
from gateway.recording.schema import json_form, location_message, raw_message, read_raw
from gateway.recording.writer import MB, Tape
from tests.gateway.recorded import (
    NAV,
    T0_NS,
    Watch,
    config,
    events_in,
    files,
    nav,
    orders,
    raw,
    tape,
    topics,
    utc,
    write,
)
from tests.gateway.test_outputs_schema import OFFSET_NS


@pytest.fixture
def watch() -> Watch:
    return Watch()


def test_a_raw_message_is_what_its_schema_says() -> None:
    old = bytes.fromhex("0807060504030201 03000000") + b"abc"  # when no sender was told
    message = raw_message(0x0102030405060708, b"abc", "10.0.0.7:4001")
    assert message == old + bytes.fromhex("0d000000") + b"10.0.0.7:4001"
    assert read_raw(message) == (0x0102030405060708, b"abc", "10.0.0.7:4001")
    assert read_raw(old) == (0x0102030405060708, b"abc", "")
    for cut in (message[:5], message[:-1], message + b"x"):
        with pytest.raises(ValueError, match="a chunk"):
            read_raw(cut)


def test_everything_comes_back_as_it_was(tmp_path: Path, watch: Watch) -> None:
    line = LineEvent("usbl0", T0_NS, True)
    written: list[Event] = [utc(), line, *(raw(n) for n in range(40)), nav(3), raw(77, 80_000)]
    written.append(msgspec.structs.replace(raw(78), source="10.0.0.7:4001"))
    writer = tape(watch, tmp_path)
    write(writer, written)
    writer.close()
    (path,) = files(tmp_path)
    run = RecordedRun([path])
    assert list(run.events()) == written
    assert (run.counts.events, run.counts.missing, run.counts.unclosed) == (len(written), 0, 0)
    assert run.config() == config()
    assert run.rate_hz == 10.0


def test_other_readers_find_all_of_it(tmp_path: Path, watch: Watch) -> None:
    sample = ImuRecord(
        t_rx_ns=0, sequence=1, delta_angle_rad=(0, 0, 1e-6), specific_force_m_s2=(0, 0, -9.8)
    )
    frame = Raw("imu0", T0_NS, KVH1750.encode(sample, KvhOptions()))
    writer = tape(watch, tmp_path)
    write(writer, [utc(), frame, raw(1), nav(1), nav(400)])
    writer.close()
    (path,) = files(tmp_path)
    assert topics(path) == {
        "/utc": 1,
        "/raw/imu0": 1,
        "/records/imu0/imu": 1,
        "/raw/usbl0": 1,
        "/nav": 2,
        "/location": 2,
    }
    with path.open("rb") as file:
        found = {c.topic: (s, c, m) for s, c, m in make_reader(file).iter_messages()}
    assert [m.log_time for _, _, m in found.values()][1] == T0_NS + OFFSET_NS
    decoded = json.loads(found["/records/imu0/imu"][2].data)
    assert decoded["sequence"] == 1
    place = json.loads(found["/location"][2].data)
    assert (place["latitude"], place["longitude"]) == (NAV.lat_deg, NAV.lon_deg)
    assert found["/location"][0].name == "foxglove.LocationFix"
    assert {(s.encoding, c.message_encoding) for s, c, _ in found.values()} == {
        ("jsonschema", "json"),
        ("ros1msg", "ros1"),
    }


def test_records_may_be_left_out(tmp_path: Path, watch: Watch) -> None:
    writer = tape(watch, tmp_path, records=False)
    write(writer, [utc(), raw(1)])
    writer.close()
    assert topics(files(tmp_path)[0]) == {"/utc": 1, "/raw/usbl0": 1}


def test_the_covariance_of_a_place_is_that_of_the_solution() -> None:
    place = location_message(NAV)
    assert place is not None
    (ee, en, _, ne, nn, _, _, _, uu) = json.loads(place)["position_covariance"]
    assert (ee, nn, uu) == (NAV.sd_e_m**2, NAV.sd_n_m**2, NAV.sd_d_m**2)
    assert en == ne
    major2, minor2 = NAV.ellipse_major_m**2, NAV.ellipse_minor_m**2
    assert ee * nn - en * ne == pytest.approx(major2 * minor2)
    assert ee + nn == pytest.approx(major2 + minor2)


def test_schemas_keep_to_what_foxglove_reads() -> None:
    """Each field of one type, objects with properties, no references and no choices."""

    class Inner(msgspec.Struct):
        x: float | None
        kind: bytes

    class Outer(msgspec.Struct):
        inner: Inner
        many: tuple[Inner, ...]
        three: tuple[float, float, float]
        named: dict[str, Inner]

    form = json_form("Outer", msgspec.json.schema(Outer), {"named": {"a": {}, "b": {}}})
    inner = {
        "title": "Inner",
        "type": "object",
        "properties": {"x": {"type": "number"}, "kind": {"type": "string"}},
    }
    assert json.loads(form.schema) == {
        "title": "Outer",
        "type": "object",
        "properties": {
            "inner": inner,
            "many": {"type": "array", "items": inner},
            "three": {"type": "array", "items": {"type": "number"}},
            "named": {"type": "object", "properties": {"a": inner, "b": inner}},
        },
    }


def test_a_file_that_is_old_is_followed_by_the_next(tmp_path: Path, watch: Watch) -> None:
    writer = tape(watch, tmp_path, max_file_s=60.0)
    written: list[Event] = [utc(), *(raw(n) for n in range(199))]
    write(writer, written, slice(0, 10))
    watch.now = 60.0
    write(writer, written, slice(10, 20))
    writer.close()
    first, second = files(tmp_path)
    assert first.name == "demo-000001-20260528T202640Z.mcap"
    # Each begins with the sample of Unix time in force: it may be read by itself.
    assert events_in(second, first) == [*written[:110], utc(), *written[110:]]


def test_a_file_that_is_full_is_followed_by_the_next(tmp_path: Path, watch: Watch) -> None:
    writer = tape(watch, tmp_path, max_file_mb=0.1, records=False)
    write(writer, [utc(), *(Raw("usbl0", n, noise(n)) for n in range(60))])
    writer.close()
    sizes = [path.stat().st_size for path in files(tmp_path)]
    assert len(sizes) == 3
    assert max(sizes) < 0.2 * MB


def noise(n: int) -> bytes:
    """5 kB that do not compress."""
    return Random(n).randbytes(5000)


def test_the_oldest_go_and_nothing_that_is_not_ours(tmp_path: Path, watch: Watch) -> None:
    foreign = tmp_path / "demo-000000-20200101T000000Z.mcap"
    foreign.write_bytes(b"somebody's own" * 1000)
    others = tape(watch, tmp_path, quota_mb=100)
    others._folder._vehicle = "demo-2"
    write(others, [utc(), raw(1)])
    others.close()
    (other,) = tmp_path.glob("demo-2-*")
    writer = tape(watch, tmp_path, max_file_mb=0.1, quota_mb=0.35)
    write(writer, [utc(), *(Raw("usbl0", n, noise(n)) for n in range(300))])
    writer.close()
    ours = [path for path in files(tmp_path) if path not in (foreign, other)]
    assert foreign.exists()
    assert other.exists()
    numbers = [int(path.name.split("-")[1]) for path in ours]
    assert numbers[0] > 5
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    total = sum(path.stat().st_size for path in [*ours, foreign])
    assert 0.15 * MB < total < 0.45 * MB
    run = RecordedRun(ours)
    last = list(run.events())[-1]
    assert isinstance(last, Raw)
    assert last.t_rx_ns == 299
    assert run.counts.missing > 0


def test_a_clock_that_jumps_back_overwrites_nothing(tmp_path: Path, watch: Watch) -> None:
    for unix in (1_780_000_000.0, 0.0, 0.0):
        watch.unix = unix
        writer = tape(watch, tmp_path)
        write(writer, [utc(), raw(1)])
        writer.close()
    assert [path.name for path in files(tmp_path)] == [
        "demo-000001-20260528T202640Z.mcap",
        "demo-000002-19700101T000000Z.mcap",
        "demo-000003-19700101T000000Z.mcap",
    ]


def test_two_runs_are_not_one(tmp_path: Path, watch: Watch) -> None:
    for run in ("a", "b"):
        writer = Tape(orders(tmp_path, run))
        write(writer, [utc(), raw(1)])
        writer.close()
    one, two = files(tmp_path)
    with pytest.raises(CaptureError, match=f"name the files of one: {one.name}; {two.name}"):
        RecordedRun([one, two])


def test_another_file_is_no_recording(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    assert is_recording(path)
    with pytest.raises(CaptureError, match="not a recording of usblnav"):
        RecordedRun([path])
    assert not is_recording(tmp_path)


def test_the_configuration_of_another_version_is_said(tmp_path: Path, watch: Watch) -> None:
    writer = tape(watch, tmp_path)
    write(writer, [utc()])
    writer.close()
    (path,) = files(tmp_path)
    path.write_bytes(path.read_bytes().replace(b'"sound_speed_m_s"', b'"sound_sqeed_m_s"'))
    with pytest.raises(ConfigError, match=r"recorded by usblnav 1\.2\.3: sound_sqeed_m_s: unknown"):
        RecordedRun([path]).config()


def test_reports_come_back_to_the_last_bit(tmp_path: Path, watch: Watch) -> None:
    report = nav(5)
    writer = tape(watch, tmp_path)
    write(writer, [utc(), report])
    writer.close()
    (_, found) = events_in(*files(tmp_path))
    assert isinstance(found, Report)
    assert msgspec.json.decode(found.data, type=type(NAV)).fixes_used == 5
    assert found == report
