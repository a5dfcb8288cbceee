"""Round trip through the filter process: a sample sent to its solution received."""

import asyncio
import time

import numpy as np

from gateway.config import Config, load
from gateway.filter_process.host import FilterHost
from gateway.messages import FilterOutput, ImuBlock, NavSolution
from tests.bench.replayed import Row, Source
from tests.bench.steps import arrivals, samples

RATE_HZ = 200.0
SAMPLES = 2000


def measure(source: Source) -> list[Row]:
    """Median and 99th percentile at the pace of a live IMU."""
    config = load(source.config)
    blocks = samples(arrivals(source, config, SAMPLES + 200), 1)[:SAMPLES]
    trips_us = asyncio.run(_trips(config, blocks))
    return [
        ("filter process, sample to solution, median", float(np.median(trips_us)), "us"),
        ("filter process, sample to solution, 99 %", float(np.percentile(trips_us, 99)), "us"),
    ]


async def _trips(config: Config, blocks: list[ImuBlock]) -> list[float]:
    """Microseconds from sending each sample until its own solution is here."""
    sent: dict[int, float] = {}
    trips: list[float] = []

    def take(output: FilterOutput) -> None:
        if isinstance(output, NavSolution) and output.t_ns in sent:
            trips.append((time.perf_counter() - sent[output.t_ns]) * 1e6)

    host = FilterHost(config, 10.0 * RATE_HZ, take)  # so that each sample has its solution
    running = asyncio.create_task(host.run())
    await host.ready.wait()
    begun = time.perf_counter()
    for n, block in enumerate(blocks):
        await asyncio.sleep(max(0.0, begun + n / RATE_HZ - time.perf_counter()))
        sent[int.from_bytes(block.t_ns, "little", signed=True)] = time.perf_counter()
        host.send(block)
    await asyncio.sleep(0.1)
    running.cancel()
    await asyncio.wait([running])
    assert len(trips) > 0.99 * len(blocks)
    return trips
