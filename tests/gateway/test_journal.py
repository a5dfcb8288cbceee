"""The log on a pipe that nobody reads for a while."""

import logging
import os
from collections.abc import Iterator

import pytest

from gateway.machine.journal import PatientHandler

LINE = "x" * 100


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        os.close(end)


@pytest.fixture
def log(pipe: tuple[int, int]) -> Iterator[logging.Logger]:
    logger = logging.Logger("test")
    logger.addHandler(PatientHandler(pipe[1]))
    yield logger


def test_lines_arrive(pipe: tuple[int, int], log: logging.Logger) -> None:
    log.warning("long: %s", "y" * 10_000)
    log.warning("two")
    assert os.read(pipe[0], 65536) == b"long: " + b"y" * 10_000 + b"\ntwo\n"


def test_a_reader_that_stops_holds_up_nothing_and_hears_what_it_missed(
    pipe: tuple[int, int], log: logging.Logger
) -> None:
    for _ in range(2_000):  # three times what a pipe takes
        log.warning("%s", LINE)
    heard = os.read(pipe[0], 1 << 20)
    assert set(heard.splitlines()[:-1]) == {LINE.encode()}
    log.warning("again")
    assert b"again (" in (said := os.read(pipe[0], 4096))
    assert heard.count(b"\n") + int(said.split(b"(")[1].split()[0]) == 2_000
    log.warning("more")
    assert os.read(pipe[0], 4096) == b"more\n"


def test_a_log_that_is_gone_is_no_error(pipe: tuple[int, int], log: logging.Logger) -> None:
    dead, end = os.pipe()
    os.close(dead)
    gone = logging.Logger("gone")
    gone.addHandler(PatientHandler(end))
    gone.warning("into the void")
    os.close(end)
