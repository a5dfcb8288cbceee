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
    Prepare,
    Ready,
    encode,
    read_of_template,
)
from gateway.filter_process.pair import pair
from tests.bench.replayed import Row, Source

WARM_STARTS = 5


def measure(source: Source) -> list[Row]:
    """Seconds by the clock and of processor; the cold start is the first ever on a machine."""
    config = load(source.config)
    with tempfile.TemporaryDirectory() as cache:
        cold = seconds(config, cache, [Compiling, Ready])
        warm = [seconds(config, cache, [Ready]) for _ in range(WARM_STARTS)]
    return [
        ("filter process ready, nothing compiled yet", cold[0], "s"),
        ("of processor", cold[1], "s"),
        ("filter process ready, all in the cache", median(clock for clock, _ in warm), "s"),
        ("of processor", median(processor for _, processor in warm), "s"),
    ]


def seconds(config: Config, cache: str, words: list[type]) -> tuple[float, float]:
    """Clock and processor time of one start that must say these words."""
    ours, theirs = pair()
    ours.setblocking(True)
    with ours:
        ours.send(encode(Prepare(config, 1.0)))
        begun = time.perf_counter()
        with theirs:
            template = subprocess.Popen(
                [sys.executable, "-m", "gateway.filter_process", str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                env=os.environ | {"NUMBA_CACHE_DIR": cache},
            )
        said = [type(read_of_template(ours.recv(MAX_MESSAGE))) for _ in words]
        took = time.perf_counter() - begun
    _, status, usage = os.wait4(template.pid, 0)
    template.returncode = os.waitstatus_to_exitcode(status)
    assert said == words
    return took, usage.ru_utime + usage.ru_stime
