"""Recordings as files: what is in them, when the next begins, which go, and what damage costs."""

import json
import shutil
from pathlib import Path
from random import Random

import msgspec
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Message
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
    batches,
    config,
    events_in,
    files,
    nav,
    orders,
    raw,
    records_in,
    topics,
    utc,
)
from tests.gateway.test_outputs_schema import OFFSET_NS


class Watch:
    """Clocks in the test's hand: one that only grows, one that is set."""

    now = 0.0
    unix = 1_780_000_000.0


@pytest.fixture
def watch() -> Watch:
    return Watch()


def tape(watch: Watch, folder: Path, **settings: object) -> Tape:
    return Tape(orders(folder, **settings), lambda: watch.now, lambda: watch.unix)


def write(to: Tape, events: list[Event], part: slice = slice(None)) -> None:
    for batch in batches(events)[part]:
        to.take(batch)
        assert to.flush() == batch.first + len(batch.events)


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


def unclosed(folder: Path, watch: Watch, events: list[Event]) -> Path:
    """A file as a killed writer leaves it."""
    writer = tape(watch, folder)
    write(writer, events)
    (path,) = files(folder)
    copy = folder / "copy"
    shutil.copy(path, copy)
    writer.close()
    return copy


def chunk_spans(data: bytes) -> tuple[list[int], list[int]]:
    """Where the chunks of a file begin and end, by the format's own lengths."""
    heads, ends, at = [], [], 8
    while at < len(data) and data[at] != Opcode.DATA_END:
        end = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        if data[at] == Opcode.CHUNK:
            heads.append(at)
            ends.append(end)
        at = end
    return heads, ends


def chunk_heads(data: bytes) -> list[int]:
    return chunk_spans(data)[0]


def test_what_was_flushed_survives_a_kill(tmp_path: Path, watch: Watch) -> None:
    written: list[Event] = [utc(), *(raw(n) for n in range(35))]
    path = unclosed(tmp_path, watch, written)
    run = RecordedRun([path])
    assert list(run.events()) == written
    assert run.counts.unclosed == 1


def test_a_file_cut_off_anywhere_gives_all_whole_chunks(tmp_path: Path, watch: Watch) -> None:
    written: list[Event] = [utc(), *(raw(n) for n in range(35))]
    whole = unclosed(tmp_path, watch, written).read_bytes()
    cut = tmp_path / "cut"
    seen = set()
    chunks = [range(head + 1, end) for head, end in zip(*chunk_spans(whole), strict=True)]
    for size in range(0, len(whole), 37):
        cut.write_bytes(whole[:size])
        try:
            run = RecordedRun([cut])
        except CaptureError as error:
            assert str(error) == f"{cut}: cut off before its first event"
            continue
        found = list(run.events())
        assert found == written[: len(found)]
        seen.add(len(found))
        lost = [damage.at_byte + damage.bytes for damage in run.counts.damaged]
        assert lost == [size] * any(size in chunk for chunk in chunks)
    assert seen == {0, 10, 20, 30, 36}


def closed(folder: Path, watch: Watch, events: list[Event]) -> bytes:
    writer = tape(watch, folder)
    write(writer, events)
    writer.close()
    return files(folder)[0].read_bytes()


def overwritten(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize("offset", [0, 8, 20, 33, 40, 42, 60])
@pytest.mark.parametrize("chunk", range(4))
def test_a_damaged_chunk_costs_itself_alone(
    tmp_path: Path, watch: Watch, chunk: int, offset: int
) -> None:
    """Opcode, length, times, sum, name or content of it; the first one holds the channels too."""
    written: list[Event] = [utc(), *(raw(n) for n in range(39))]
    whole = closed(tmp_path, watch, written)
    heads = chunk_heads(whole)
    assert len(heads) == 4
    at = heads[chunk] + offset
    path = tmp_path / "broken"
    path.write_bytes(overwritten(whole, at, bytes([whole[at] ^ 0x55])))
    run = RecordedRun([path])
    found = list(run.events())
    if offset == 20:  # times that nobody here goes by
        assert (found, run.counts.damaged) == (written, [])
        return
    assert found == written[: 10 * chunk] + written[10 * chunk + 10 :]
    (damage,) = run.counts.damaged
    assert (damage.file, damage.at_byte) == (str(path), heads[chunk])
    is_last = chunk == 3
    assert damage.events == (None if is_last else 10)
    assert run.counts.missing == (0 if is_last else 10)
    if not is_last:
        assert damage.bytes == heads[chunk + 1] - heads[chunk]
    assert (run.counts.unclosed, run.counts.events) == (0, 30)


def test_a_hole_over_several_chunks_is_one_place(tmp_path: Path, watch: Watch) -> None:
    """Sectors that read as zeros."""
    written: list[Event] = [utc(), *(raw(n) for n in range(59))]
    whole = closed(tmp_path, watch, written)
    heads = chunk_heads(whole)
    begin, end = heads[2] - 20, heads[4] + 50  # an index, two chunks, and what a third begins with
    path = tmp_path / "broken"
    path.write_bytes(overwritten(whole, begin, bytes(end - begin)))
    run = RecordedRun([path])
    assert list(run.events()) == written[:20] + written[50:]
    (damage,) = run.counts.damaged
    assert begin - 100 < damage.at_byte <= heads[2]
    assert damage.at_byte + damage.bytes == heads[5]
    assert damage.events == run.counts.missing == 30
    assert str(damage) == (
        f"{path}: damaged at byte {damage.at_byte}: {damage.bytes} bytes, 30 events lost"
    )


def test_what_is_behind_a_damaged_end_is_counted_in_the_next_file(
    tmp_path: Path, watch: Watch
) -> None:
    written: list[Event] = [utc(), *(raw(n) for n in range(39))]
    writer = tape(watch, tmp_path, max_file_s=60.0)
    write(writer, written, slice(0, 2))
    watch.now = 60.0
    write(writer, written, slice(2, None))
    writer.close()
    first, second = files(tmp_path)
    whole = first.read_bytes()
    cut = chunk_heads(whole)[2] + 60
    first.write_bytes(whole[:cut])
    run = RecordedRun([first, second])
    found = [event for event in run.events() if not isinstance(event, type(utc()))]
    assert found == written[1:20] + written[30:]
    (damage,) = run.counts.damaged
    assert (damage.file, damage.at_byte + damage.bytes, damage.events) == (str(first), cut, 10)
    assert (run.counts.unclosed, run.counts.missing) == (1, 10)


def test_any_damage_costs_what_it_hit(tmp_path: Path, watch: Watch) -> None:
    """A chunk at most, and it is told; or the file's beginning, without which it is nothing."""
    written: list[Event] = [utc(), *(raw(n) for n in range(98)), nav(1)]
    whole = closed(tmp_path, watch, written)
    broken, rng = tmp_path / "broken", Random(1)
    hit = 0
    for _ in range(300):
        at = rng.randrange(len(whole))
        broken.write_bytes(overwritten(whole, at, bytes([whole[at] ^ rng.randrange(1, 256)])))
        try:
            run = RecordedRun([broken])
            run.config()
        except (CaptureError, ConfigError) as error:
            assert str(error).startswith(str(broken))
            assert at < chunk_heads(whole)[0]
            continue
        found = list(run.events())
        lost = [event for event in written if event not in found]
        assert found == [event for event in written if event not in lost]
        assert len(lost) in (0, 10)
        hit += bool(lost)
        assert bool(run.counts.damaged) >= bool(lost)
    assert hit > 50


def test_events_that_two_writers_wrote_come_once(tmp_path: Path, watch: Watch) -> None:
    """One is killed before it could say what it has saved: the next is given that again."""
    written: list[Event] = [utc(), *(raw(n) for n in range(39))]
    first = tape(watch, tmp_path)
    write(first, written, slice(0, 3))
    second = tape(watch, tmp_path)
    write(second, written, slice(1, None))
    second.close()
    first.close()
    run = RecordedRun(files(tmp_path)[::-1])
    assert list(run.events()) == written
    assert (run.counts.repeated, run.counts.missing) == (20, 0)


def test_what_is_missing_is_counted(tmp_path: Path, watch: Watch) -> None:
    written: list[Event] = [utc(), *(raw(n) for n in range(39))]
    writer = tape(watch, tmp_path)
    write(writer, written, slice(1, None, 2))
    writer.close()
    run = RecordedRun(files(tmp_path))
    assert list(run.events()) == written[10:20] + written[30:]
    assert run.counts.missing == 20


def test_numbers_wrap(tmp_path: Path, watch: Watch) -> None:
    """After 2**32 events."""
    written: list[Event] = [utc(), *(raw(n) for n in range(39))]
    writer = tape(watch, tmp_path)
    for batch in batches(written):
        writer.take(msgspec.structs.replace(batch, first=batch.first + (1 << 32) - 15))
    writer.close()
    assert events_in(*files(tmp_path)) == written
    assert {r.sequence for r in records_in(files(tmp_path)[0]) if isinstance(r, Message)} >= {0, 24}


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
