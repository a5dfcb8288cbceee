"""Recordings that were cut off or damaged: what could be read is, and what that cost is counted."""

import shutil
from pathlib import Path
from random import Random

import msgspec
import pytest
from mcap.opcode import Opcode
from mcap.records import Message

from drivers.capture.files import CaptureError
from gateway.errors import ConfigError
from gateway.recording.events import Event
from gateway.recording.reader import RecordedRun
from tests.gateway.recorded import (
    Watch,
    batches,
    events_in,
    files,
    nav,
    raw,
    records_in,
    tape,
    utc,
    write,
)


@pytest.fixture
def watch() -> Watch:
    return Watch()


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
