"""A daemon killed and started at once: `python -m tests.bench.restart [TIMES [CHECKOUT...]]`.

Prints medians of the seconds from its start to its first solution on Zenoh, and of the processor
time that all its processes took until then; with several checkouts they start by turns.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import monotonic

import yaml
import zenoh

from gateway.emulator import twin
from tests.gateway.emulated import make
from tests.integration.rig import brisk, session
from tests.loopback import free_endpoint
from tests.shared_data import ROOT

TIMES = 10
PATIENCE_S = 60.0
TICKS = os.sysconf("SC_CLK_TCK")


class Ear:
    """Hears the solutions of whatever gateway runs."""

    def __init__(self, endpoint: str) -> None:
        settings = {"mode": "peer", "listen": {"endpoints": [endpoint]}}
        settings["scouting"] = {"multicast": {"enabled": False}}
        self._heard = threading.Event()
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
        self._session.declare_subscriber("usblnav/*/nav", lambda _sample: self._heard.set())

    def wait(self) -> None:
        """For the next solution."""
        self._heard.clear()
        if not self._heard.wait(PATIENCE_S):
            raise SystemExit("no solution")

    def close(self) -> None:
        self._session.close()


@contextmanager
def running(checkout: Path, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A command of a checkout, killed at the end with all that it started."""
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway", *arguments],
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        while session(process.pid):
            pass


def processor_s(leader: int) -> float:
    """What the processes of a session have taken."""
    stats = [(Path("/proc") / str(pid) / "stat").read_text() for pid in session(leader)]
    taken = [stat.rpartition(")")[2].split()[11:13] for stat in stats]
    return sum(int(user) + int(system) for user, system in taken) / TICKS


def main(times: int, checkouts: list[Path]) -> None:
    """Start each by turns, and print."""
    with tempfile.TemporaryDirectory() as name:
        folder, endpoint = Path(name), free_endpoint()
        scenario = brisk(folder) | {"duration_s": 86_400}
        config = twin.gateway_config(make(scenario))
        config["outputs"] = [{"type": "zenoh", "mode": "peer", "connect": [endpoint]}]
        config["state"] = {"period_s": 0.5}
        (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario))
        ear, took = Ear(endpoint), {checkout: [] for checkout in checkouts}
        with running(ROOT, "emulate", "-c", str(folder / "scenario.yaml")):
            for n in range(times + 1):
                for k, checkout in enumerate(checkouts):
                    state = folder / f"state{k}"
                    config["state"]["file"] = str(state)
                    (folder / "config.yaml").write_text(yaml.safe_dump(config))
                    begun = monotonic()
                    with running(checkout, "run", "-c", str(folder / "config.yaml")) as gateway:
                        ear.wait()
                        figures = monotonic() - begun, processor_s(gateway.pid)
                        written = state.stat().st_mtime_ns if state.exists() else 0
                        while not state.exists() or state.stat().st_mtime_ns == written:
                            ear.wait()
                    if n:  # the first one found no state
                        took[checkout].append(figures)
        ear.close()
    print(
        f"{times} starts from a state file, load {os.getloadavg()[0]:.1f}: s (least, most); CPU s"
    )
    for checkout, all_of_it in took.items():
        wall, taken = ([figures[i] for figures in all_of_it] for i in (0, 1))
        print(
            f"{checkout}: {median(wall):.2f} ({min(wall):.2f}, {max(wall):.2f});"
            f" {median(taken):.2f}"
        )


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else TIMES,
        [Path(argument) for argument in sys.argv[2:]] or [ROOT],
    )
