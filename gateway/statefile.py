"""The newest state of filter and clocks on disk, from which a gateway that was away begins again.

A file is ``MAGIC``, the version (uint16, little-endian), a BLAKE2b digest of the rest (16 bytes),
and the rest: msgpack of `Saved`. It is replaced as a whole, so that a reader finds the old one or
the new one.
"""

import hashlib
import logging
import os
import threading
import time
from contextlib import suppress
from pathlib import Path

import msgspec

from gateway.clock import Clocks, aged
from gateway.config import Config, StateFile
from gateway.errors import cause
from gateway.machine.bootclock import Moment, now, unbelievable
from gateway.machine.claim import ClaimedError, claim
from gateway.messages import SavedState
from gateway.resume import COLD, Resume

MAGIC = b"usblnav state\n"
VERSION = 2
"""Changes with the layout of the file, of `SavedState`, of the clocks, and of the state vector."""
READABLE = (1, VERSION)
"""The first had no clocks."""
DIGEST_SIZE = 16
END_S = 0.5
"""How long the end of a run waits for the disk."""

_log = logging.getLogger(__name__)


class Saved(msgspec.Struct, frozen=True, array_like=True):
    """What a file holds."""

    written: Moment
    vehicle: str
    setup: bytes
    """Digest of all that gives the state its meaning, see `setup_of`."""
    state: SavedState
    clocks: Clocks = {}


class StateFileError(Exception):
    """The file holds no state for this gateway; it is set aside under the suffix."""

    def __init__(self, why: str, suffix: str) -> None:
        super().__init__(why)
        self.suffix = suffix


def place(settings: StateFile) -> Path | None:
    """Where the state is kept: as configured, else where the service manager says; or nowhere."""
    if settings.file is not None:
        return Path(settings.file)
    folder = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(folder) / "state" if folder else None


def claimed(path: Path | None) -> tuple[Path | None, int | None]:
    """The place, if no other gateway keeps its state there, and what holds it for this process."""
    try:
        return path, None if path is None else claim(path)
    except ClaimedError as error:
        _log.warning("state file %s: %s; going on without one", path, error)
        return None, None


def setup_of(config: Config) -> bytes:
    """Digest of the vehicle, what is aboard, where it began and how it is estimated.

    The devices' lines and the outputs may change between two runs.
    """
    devices = {
        name: msgspec.structs.replace(device, link=None) for name, device in config.devices.items()
    }
    what = (
        config.vehicle,
        devices,
        config.beacons,
        config.initial,
        config.sound_speed_m_s,
        config.filter,
    )
    return _digest(msgspec.msgpack.encode(what))


def pack(saved: Saved) -> bytes:
    """The bytes of a file."""
    body = msgspec.msgpack.encode(saved)
    return MAGIC + VERSION.to_bytes(2, "little") + _digest(body) + body


def unpack(data: bytes, config: Config) -> Saved:
    """What a file holds that this gateway can go on from.

    Raises
    ------
    StateFileError
        For anything else.
    """
    head = len(MAGIC) + 2
    if data[: len(MAGIC)] != MAGIC:
        raise StateFileError("is damaged or no state file", "damaged")
    version = int.from_bytes(data[len(MAGIC) : head], "little")
    if version not in READABLE:
        raise StateFileError(f"is of version {version}, not {VERSION}", "foreign")
    digest, body = data[head : head + DIGEST_SIZE], data[head + DIGEST_SIZE :]
    if digest != _digest(body):
        raise StateFileError("is damaged", "damaged")
    try:
        saved = msgspec.msgpack.decode(body, type=Saved)
    except msgspec.DecodeError as error:
        raise StateFileError("is of another version", "foreign") from error
    if saved.vehicle != config.vehicle:
        raise StateFileError(f"is of the vehicle {saved.vehicle}", "foreign")
    if saved.setup != setup_of(config):
        raise StateFileError("is of another configuration", "foreign")
    return saved


def resume(path: Path, config: Config, at: Moment) -> Resume:
    """What to go on from, its times on the present monotonic clock.

    Whatever the file is, one line of the log says what becomes of it; one that is of no use is set
    aside. Of clocks something is left however old it is.
    """
    try:
        saved = unpack(path.read_bytes(), config)
    except FileNotFoundError:
        return COLD
    except OSError as error:
        _log.warning("state file %s: %s; starting cold", path, cause(error))
        return COLD
    except StateFileError as error:
        aside = path.with_name(f"{path.name}.{error.suffix}")
        kept = f"kept as {aside.name}" if _moved(path, aside) else "left where it is"
        _log.warning("state file %s: %s; %s; starting cold", path, error, kept)
        return COLD
    return Resume(_state_of(path, saved, config, at), _clocks_of(saved, at))


def _state_of(path: Path, saved: Saved, config: Config, at: Moment) -> SavedState | None:
    """The filter's state with its time of now; None where it is too old, or may be."""
    doubt = unbelievable(saved.written, at)
    if doubt is not None:
        _log.warning("state file %s: %s; starting cold", path, doubt)
        return None
    age_ns = at.since(saved.written) + saved.written.mono_ns - saved.state.t_ns
    if age_ns > config.state.max_age_s * 1e9:
        _log.warning("state file %s: %s old; starting cold", path, _span(age_ns * 1e-9))
        return None
    _log.info("state file %s: going on from a state %s old", path, _span(age_ns * 1e-9))
    return msgspec.structs.replace(saved.state, t_ns=at.mono_ns - age_ns)


def _clocks_of(saved: Saved, at: Moment) -> Clocks:
    """What is left of the devices' clocks."""
    now_ns = at.mono_ns if at.boot == saved.written.boot else None
    return {
        device: {source: aged(clock, now_ns) for source, clock in clocks.items()}
        for device, clocks in saved.clocks.items()
    }


def write(path: Path, data: bytes) -> None:
    """Replace a file as a whole.

    Raises
    ------
    OSError
        The old one is still there, then.
    """
    new = path.with_name(path.name + ".new")
    try:
        with new.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except OSError:
        with suppress(OSError):
            new.unlink()
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


class KeeperStatus(msgspec.Struct, frozen=True):
    """How the state file fares."""

    file: str
    age_s: float | None
    """Since the last state was written; None before the first."""
    written: int
    failed: int


class Keeper:
    """Writes the newest state every few seconds, in a thread of its own: a disk may be slow.

    Parameters
    ----------
    path, config
        Where to, and what for.
    """

    def __init__(self, path: Path, config: Config) -> None:
        self._path = path
        self._vehicle, self._setup = config.vehicle, setup_of(config)
        self._period_s = config.state.period_s
        self._newest: tuple[SavedState, Clocks] | None = None
        self._wanted = threading.Condition()
        self._ends = False
        self._written = self._failed = 0
        self._failing = False
        self._written_at: float | None = None
        self._thread = threading.Thread(target=self._run, name="state file", daemon=True)
        self._thread.start()

    @property
    def status(self) -> KeeperStatus:
        """How the file fares now."""
        at = self._written_at
        age_s = None if at is None else round(time.monotonic() - at, 1)
        return KeeperStatus(str(self._path), age_s, self._written, self._failed)

    def keep(self, state: SavedState, clocks: Clocks) -> None:
        """Take the newest state; never waits for the disk."""
        with self._wanted:
            self._newest = state, clocks
            self._wanted.notify()

    def close(self) -> None:
        """Write what there is, unless the disk takes too long."""
        with self._wanted:
            self._ends = True
            self._wanted.notify()
        self._thread.join(END_S)

    def _run(self) -> None:
        while (newest := self._next()) is not None:
            self._write(*newest)
            with self._wanted:
                self._wanted.wait_for(lambda: self._ends, self._period_s)

    def _next(self) -> tuple[SavedState, Clocks] | None:
        """The next state to write; None at the end."""
        with self._wanted:
            self._wanted.wait_for(lambda: self._ends or self._newest is not None)
            newest, self._newest = self._newest, None
        return newest

    def _write(self, state: SavedState, clocks: Clocks) -> None:
        """Write a state; a disk that fails is said once, and so is its recovery."""
        try:
            write(self._path, pack(Saved(now(), self._vehicle, self._setup, state, clocks)))
        except OSError as error:
            self._failed += 1
            if not self._failing:
                self._failing = True
                why = cause(error)
                _log.warning("state file %s: %s; trying again", self._path, why)
            return
        self._written += 1
        self._written_at = time.monotonic()
        if self._failing:
            self._failing = False
            _log.info("state file %s: written again", self._path)


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=DIGEST_SIZE).digest()


def _moved(path: Path, to: Path) -> bool:
    try:
        path.replace(to)
    except OSError:
        return False
    return True


def _span(seconds: float) -> str:
    """A length of time as a person says it."""
    for unit, name in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{seconds:.1f} s"
