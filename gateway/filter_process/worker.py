"""The filter process itself: reads measurements from its host, runs the estimator, answers."""

import socket
from collections.abc import Iterable

from gateway import realtime
from gateway.estimator import Estimator
from gateway.filter_process.channel import (
    Prepare,
    Start,
    encode,
    read_in_worker,
    receive,
)
from gateway.filter_process.progress import Progress
from gateway.messages import Checkpoint, FilterOutput, SavedState


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
    taken = said = 0

    def answer(outputs: Iterable[FilterOutput]) -> None:
        nonlocal said
        for output in outputs:
            if not isinstance(output, SavedState | Checkpoint):
                said += 1
                if said <= start.heard:
                    continue
            channel.send(encode(output))

    while data := receive(channel):
        progress.begin(taken, said)
        measurement = read_in_worker(data)
        assert not isinstance(measurement, Start)
        answer(estimator.feed(measurement))
        taken += 1
        progress.idle()
        collector.quiet()
    answer(estimator.finish())  # heard where the host ends in peace
