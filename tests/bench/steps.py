"""Processor time of each step on the way from packets to sentences."""

import time
from collections.abc import Callable
from functools import partial
from itertools import islice
from statistics import median

from drivers.capture.reader import read_packets
from drivers.capture.streams import Payload, read_streams
from gateway.config import Config, load, wire_format
from gateway.engine import Track
from gateway.estimator import Estimator
from gateway.fusion.filter import Filter
from gateway.fusion.memory import Memory
from gateway.fusion.observation import Model
from gateway.fusion.warmup import warm_up
from gateway.ingest import intakes
from gateway.messages import Fix, ImuBlock, Innovation, Measurement, NavSolution
from gateway.outputs import nmea
from gateway.outputs.schema import nav_report
from tests.bench.replayed import Row, Source

RUNS = 7
PACKETS = 20_000
BATCH = 64
SENTENCES = ("GGA", "RMC", "HDT", "VTG", "GST", "ZDA")


def measure(source: Source) -> list[Row]:
    """Microseconds of each step."""
    warm_up()
    config = load(source.config)
    measurements = arrivals(source, config, PACKETS)
    return [
        ("packet of a capture, unzipped and parsed", _reading(source), "us"),
        ("frame decoded (KVH)", _decoding(source, config), "us"),
        ("frame decoded, timed and turned to body axes", _intake(source, config), "us"),
        ("filter step, 200 Hz, in batches", _stepping(config, measurements), "us"),
        ("fix linearised, gated, used and reported", _updating(config, measurements), "us"),
        ("NMEA epoch of six sentences", _sentences(config, measurements), "us"),
    ]


def arrivals(source: Source, config: Config, packets: int) -> list[Measurement]:
    """Measurements of the first packets, one for each frame, as they arrive live."""
    devices = intakes(config)
    found: list[Measurement] = []
    for name, data, t_ns, _ in _payloads(source, config, packets):
        devices[name].feed(data, t_ns)
        found += devices[name].flush()
    return found


def samples(measurements: list[Measurement], per_block: int) -> list[ImuBlock]:
    """The inertial samples in blocks of a size."""
    blocks = [m for m in measurements if isinstance(m, ImuBlock)]
    return [
        ImuBlock(
            b"".join(b.t_ns for b in blocks[k : k + per_block]),
            b"".join(b.rows for b in blocks[k : k + per_block]),
        )
        for k in range(0, len(blocks), per_block)
    ]


def _payloads(source: Source, config: Config, packets: int) -> list[Payload]:
    links = {name: device.link for name, device in config.devices.items()}
    return list(islice(read_streams([source.capture], links), packets))


def _median_us(work: Callable[[], int]) -> float:
    """Microseconds an item, `work` telling how many it did."""
    took = []
    for _ in range(RUNS):
        begun = time.process_time()
        items = work()
        took.append((time.process_time() - begun) * 1e6 / items)
    return median(took)


def _reading(source: Source) -> float:
    return _median_us(lambda: sum(1 for _ in islice(read_packets(source.capture), PACKETS)))


def _decoding(source: Source, config: Config) -> float:
    imu, device = config.imu
    frames = [data for name, data, *_ in _payloads(source, config, PACKETS) if name == imu]
    codec, options = wire_format(device)

    def work() -> int:
        decoder = codec.decoder(options)
        return sum(1 for frame in frames for _ in decoder.feed(frame, 0))

    return _median_us(work)


def _intake(source: Source, config: Config) -> float:
    imu, _ = config.imu
    chunks = [(d, t) for name, d, t, _ in _payloads(source, config, PACKETS) if name == imu]

    def work() -> int:
        device = intakes(config)[imu]
        for n, (data, t_ns) in enumerate(chunks, 1):
            device.feed(data, t_ns)
            if n % BATCH == 0:
                device.flush()
        return len(chunks)

    return _median_us(work)


def _stepping(config: Config, measurements: list[Measurement]) -> float:
    blocks = samples(measurements, BATCH)

    def work() -> int:
        estimator = Estimator(config, rate_hz=1.0)
        for block in blocks:
            for _ in estimator.feed(block):
                pass
        return sum(len(block.t_ns) // 8 for block in blocks)

    return _median_us(work)


class _TimedFilter(Filter):
    """A filter that keeps the processor time of each update, wherever the timeline calls it."""

    def __init__(self, model: Model, memory: Memory, took_us: list[float]) -> None:
        super().__init__(model, memory)
        self._took_us = took_us

    def apply(self, fix: Fix, track: Track) -> Innovation:
        begun = time.process_time()
        verdict = super().apply(fix, track)
        self._took_us.append((time.process_time() - begun) * 1e6)
        return verdict


def _updating(config: Config, measurements: list[Measurement]) -> float:
    took_us: list[float] = []
    estimator = Estimator(config, rate_hz=10.0, engine=partial(_TimedFilter, took_us=took_us))
    for measurement in measurements:
        for _ in estimator.feed(measurement):
            pass
    return median(took_us)


def _sentences(config: Config, measurements: list[Measurement]) -> float:
    estimator = Estimator(config, rate_hz=10.0)
    outputs = (output for m in measurements[:2000] for output in estimator.feed(m))
    reports = [nav_report(output, 0) for output in outputs if isinstance(output, NavSolution)]

    def work() -> int:
        for report in reports:
            nmea.epoch(report, report.utc_ns, SENTENCES, "GP")
        return len(reports)

    return _median_us(work)
