"""The filter process itself: reads measurements from its host, runs the estimator, answers.

Run as ``python -m gateway.filter_process.worker FD``. It ends when the host closes the channel, and
leaves signals to the host, which decides about the whole.
"""

import signal
import socket
import sys

from gateway import realtime
from gateway.estimator import Estimator
from gateway.filter_process.channel import (
    MAX_MESSAGE,
    Compiling,
    Ready,
    Start,
    encode,
    read_in_worker,
)
from gateway.fusion.warmup import warm_up
from gateway.nav.compiled import told_of_compiling


def main(fd: int) -> None:
    """Serve one host until it closes the channel."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    with socket.socket(fileno=fd) as channel:
        try:
            _serve(channel)
        except (BrokenPipeError, ConnectionResetError):
            return  # the host is gone


def _serve(channel: socket.socket) -> None:
    start = read_in_worker(channel.recv(MAX_MESSAGE))
    assert isinstance(start, Start)
    with told_of_compiling(lambda: channel.send(encode(Compiling()))):
        estimator = Estimator(start.config, start.rate_hz, start.resume)
        warm_up()
    collector = realtime.Collector()
    collector.settle()
    realtime.enter(start.config.realtime)  # what is not granted, the host has said
    channel.send(encode(Ready()))
    while data := channel.recv(MAX_MESSAGE):
        measurement = read_in_worker(data)
        assert not isinstance(measurement, Start)
        for output in estimator.feed(measurement):
            channel.send(encode(output))
        collector.quiet()


if __name__ == "__main__":
    main(int(sys.argv[1]))
