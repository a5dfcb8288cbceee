"""What a replay is made from: packets of captures, or the recording of a run, device by device."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from drivers.capture.files import CaptureError
from drivers.capture.streams import CaptureCounts, Payload, read_streams
from gateway.clock.utc import UtcHistory, UtcSample
from gateway.config import Config
from gateway.errors import ConfigError, UsblnavError
from gateway.recording.events import Pulse, Raw
from gateway.recording.reader import SUFFIX, RecordedRun, RecordingCounts, is_recording
from gateway.resume import COLD

DEFAULT_RATE_HZ = 10.0


class Traffic(ABC):
    """Payloads and pulses of the configured devices, to where they end or cannot be read further.

    Attributes
    ----------
    config, rate_hz
        What they are replayed with; solutions a second.
    utc
        Unix time of their arrival times.
    resume
        Where it began.
    fault
        Why they ended early, or None.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        counts: CaptureCounts | RecordingCounts,
        config: Config,
        rate_hz: float,
    ) -> None:
        self.config, self.rate_hz = config, rate_hz
        self.utc = UtcHistory()
        self.resume = COLD
        self.fault: CaptureError | None = None
        self._counts = counts
        self._stored = sum(map(_size, paths))
        self._first_ns: int | None = None
        self._last_ns = 0

    def __iter__(self) -> Iterator[Payload | Pulse]:
        try:
            for item in self._items():
                if not isinstance(item, Pulse):
                    self._first_ns = item.t_rx_ns if self._first_ns is None else self._first_ns
                    self._last_ns = item.t_rx_ns
                yield item
        except CaptureError as error:
            self.fault = error

    @property
    def seconds(self) -> float:
        """From the first arrival to the last."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9

    @property
    def share(self) -> float:
        """Which part of the files was read."""
        return self._counts.file_bytes / self._stored

    @abstractmethod
    def told(self) -> dict[str, Any]:
        """What was found so far, for the summary."""

    @abstractmethod
    def _items(self) -> Iterator[Payload | Pulse]:
        """In the order in which they were heard; raises `CaptureError`, also for none at all."""


def open_traffic(paths: Sequence[Path], config: Config | None, rate_hz: float | None) -> Traffic:
    """Open captures, or the files of one recording.

    Parameters
    ----------
    config, rate_hz
        None takes those of the recording.

    Raises
    ------
    ConfigError
        For captures without a configuration, and captures beside recordings.
    UsblnavError
        For what cannot be read.
    """
    recordings = [path for path in paths if is_recording(path) or path.suffix == SUFFIX]
    if not recordings:
        if config is None:
            raise ConfigError("-c: missing; only a recording holds its configuration")
        return _Captures(paths, config, rate_hz or DEFAULT_RATE_HZ)
    if len(recordings) < len(paths):
        raise ConfigError("captures and recordings cannot be replayed together")
    try:
        run = RecordedRun(recordings)
        if config is not None:
            return _Recording(run, config, rate_hz or run.rate_hz)
        traffic = _Recording(run, run.config(), rate_hz or run.rate_hz)
        traffic.resume = run.resume()
    except CaptureError as error:
        raise UsblnavError(str(error)) from error
    return traffic


class _Captures(Traffic):
    """Packets, of which links tell whose they are."""

    def __init__(self, paths: Sequence[Path], config: Config, rate_hz: float) -> None:
        self._found = CaptureCounts()
        self._paths = paths
        super().__init__(paths, self._found, config, rate_hz)

    def told(self) -> dict[str, Any]:
        return {"capture": msgspec.to_builtins(self._found)}

    def _items(self) -> Iterator[Payload]:
        links = {names[0]: self.config.devices[names[0]].link for names in self.config.lines}
        yield from read_streams(self._paths, links, self._found)
        if not self._found.selected:
            raise CaptureError(
                f"{', '.join(map(str, self._paths))}: no packet for any device of the configuration"
                f" ({self._found.packets} packets read)"
            )


class _Recording(Traffic):
    """The chunks that the daemon took, by the names of their devices."""

    def __init__(self, run: RecordedRun, config: Config, rate_hz: float) -> None:
        self._run = run
        self._chunks = {"selected": 0, "not_selected": 0}
        super().__init__(run.paths, run.counts, config, rate_hz)

    def told(self) -> dict[str, Any]:
        return {"recording": msgspec.to_builtins(self._run.counts) | {"chunks": self._chunks}}

    def _items(self) -> Iterator[Payload | Pulse]:
        for event in self._run.events():
            if isinstance(event, UtcSample):
                self.utc.note(event)
            elif isinstance(event, Raw):
                known = event.device in self.config.devices
                self._chunks["selected" if known else "not_selected"] += 1
                if known:
                    yield Payload(event.device, event.data, event.t_rx_ns, event.source)
            elif isinstance(event, Pulse) and event.device in self.config.devices:
                yield event
        if not self._chunks["selected"]:
            raise CaptureError(
                f"{self._run.paths[0]}: no bytes for any device of the configuration"
                f" ({self._run.counts.events} events read)"
            )


def _size(path: Path) -> float:
    """Bytes of a file; of a pipe, or what cannot be read, there is no telling."""
    try:
        return path.stat().st_size or math.inf
    except OSError:
        return math.inf
