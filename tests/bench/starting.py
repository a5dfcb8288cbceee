"""From starting the filter process to its being ready: with an empty cache, and with a full one."""

import os
import subprocess
import sys
import tempfile
import time
from statistics import median

from gateway.config import Config, load
from gateway.filter_process.channel import (
    MAX_MESSAGE,
    Compiling,
    Ready,
    Start,
    encode,
    pair,
    read_in_host,
)
from tests.bench.replayed import Row, Source

WARM_STARTS = 5


def measure(source: Source) -> list[Row]:
    """Seconds; the cold start is the first ever on a machine."""
    config = load(source.config)
    with tempfile.TemporaryDirectory() as cache:
        cold_s = seconds(config, cache, [Compiling, Ready])
        warm_s = median(seconds(config, cache, [Ready]) for _ in range(WARM_STARTS))
    return [
        ("filter process ready, nothing compiled yet", cold_s, "s"),
        ("filter process ready, all in the cache", warm_s, "s"),
    ]


def seconds(config: Config, cache: str, words: list[type]) -> float:
    """One start that must say these words."""
    ours, theirs = pair()
    ours.setblocking(True)
    with ours:
        ours.send(encode(Start(config, 1.0, None)))
        begun = time.perf_counter()
        with theirs:
            worker = subprocess.Popen(
                [sys.executable, "-m", "gateway.filter_process.worker", str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                env=os.environ | {"NUMBA_CACHE_DIR": cache},
            )
        said = [type(read_in_host(ours.recv(MAX_MESSAGE))) for _ in words]
        took = time.perf_counter() - begun
    worker.wait()
    assert said == words
    return took
