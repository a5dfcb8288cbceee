"""The filter process itself: reads measurements from its host, runs the estimator, answers."""

import select
import socket
from collections.abc import Iterable, Iterator
from itertools import groupby

from gateway.estimator import Estimator
from gateway.filter_process.channel import (
    Many,
    Prepare,
    Start,
    ToWorker,
    encode,
    read_in_worker,
    receive,
)
from gateway.filter_process.progress import Progress
from gateway.machine import realtime
from gateway.messages import (
    Checkpoint,
    FilterOutput,
    ImuBlock,
    Measurement,
    NavSolution,
    SavedState,
)

PAUSE = 0.25
"""Parts of a sample's interval for which what it brings beside its solution waits."""


def serve(channel: socket.socket, progress: Progress, orders: Prepare) -> None:
    """Serve one host until it closes the channel.

    Answers that a worker before gave already, as `Start` says, are worked out again and kept back.
    """
    if not (data := receive(channel)):
        return
    start = read_in_worker(data)
    assert isinstance(start, Start)
    estimator = Estimator(orders.config, orders.rate_hz, start.resume)
    collector = realtime.Collector()
    collector.settle()
    realtime.enter(orders.config.realtime)  # what is not granted, the host has said
    pause_s = PAUSE / orders.config.imu[1].rate_hz
    taken = said = 0

    def answer(outputs: Iterable[FilterOutput], *, at_leisure: bool = False) -> None:
        nonlocal said
        for output in outputs:
            if not isinstance(output, SavedState | Checkpoint):
                said += 1
                if said <= start.heard:
                    continue
            channel.send(encode(output))
            if at_leisure and isinstance(output, NavSolution) and estimator.owes:
                # Whom it is for may wait for this core; what comes meanwhile ends the pause.
                select.select([channel], [], [], pause_s)

    while data := receive(channel):
        message = read_in_worker(data)
        came_in_time = not isinstance(message, Many)
        for measurement, count in _runs(message, start.one_by_one):
            progress.begin(taken, said, count)
            answer(estimator.feed(measurement, count), at_leisure=came_in_time)
            taken += count
            progress.idle()
        collector.quiet()
    answer(estimator.finish())  # heard where the host ends in peace


def _runs(message: ToWorker, one_by_one: bool) -> Iterator[tuple[Measurement, int]]:
    """What a message brings, blocks of samples that follow each other as one; and their number."""
    assert not isinstance(message, Start)
    if not isinstance(message, Many):
        yield message, 1
    elif one_by_one:
        yield from ((measurement, 1) for measurement in message.measurements)
    else:
        for is_block, group in groupby(message.measurements, lambda m: isinstance(m, ImuBlock)):
            if is_block:
                blocks = [block for block in group if isinstance(block, ImuBlock)]
                t_ns = b"".join(block.t_ns for block in blocks)
                yield ImuBlock(t_ns, b"".join(block.rows for block in blocks)), len(blocks)
            else:
                yield from ((measurement, 1) for measurement in group)
