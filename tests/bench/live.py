"""From the arrival of a frame to its solution's publication, live, while late fixes come in.

``python -m tests.bench.live --duration 600 --rate 1000 --fifo --awake``: emulated frames and fixes
2.5 s late every 2 s go over UDP into `usblnav run`; its solutions are heard over Zenoh and NMEA.
Sender, gateway, filter and hearers are processes of their own. Beside it, in the same run: two bare
hops of SOCK_SEQPACKET, and a publisher that puts stamps by turns as bare as can be and as the
gateway does its solutions, from before the JSON is made to the subscriber in another process.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import yaml
from numpy.typing import NDArray

from gateway.emulator import twin
from gateway.emulator.player import emulate
from tests.bench.replayed import Row
from tests.shared_data import ROOT

Times = NDArray[np.int64]

LATE_S, EVERY_S = 2.5, 2.0
IMU_LATENCY_NS = 500_000
"""As declared by the packaged scenario."""
NMEA_HZ = 100
FIFO = 20
BEFORE_S, DURING_S, AFTER_S = 0.5, 0.05, 0.5
"""Around the arrival of each fix; the run again takes a few milliseconds of `DURING_S`."""
SKIPPED_S = 5.0
"""At the beginning: the filter's first second, the receivers' first messages."""
FULL_S = 180.0
"""After which all that is kept for a time, two minutes at most, has come to its size."""
QUANTILES = (0.5, 0.99, 0.999, 1.0)
SHORT_S = 20.0


def measure() -> list[Row]:
    """The main figures of a short run at 200 Hz."""
    with tempfile.TemporaryDirectory() as folder:
        run = Live(Path(folder), 200.0, SHORT_S, Scheduling())
        rows = {row["what"]: row for row in run.rows()}
    names = ("bare Zenoh", "published as by the gateway", "arrival to Zenoh", "arrival to NMEA")
    return [
        (f"{name}, {label}", rows[name][key], "ms")
        for name in names
        for label, key in (("median", "p50"), ("99 %", "p99"))
    ]


class Scheduling(NamedTuple):
    """What the gateway gets: a priority of SCHED_FIFO, or a niceness; cores that stay awake."""

    fifo: int = 0
    niceness: int = 0
    awake: bool = False

    def realtime(self) -> dict[str, Any]:
        """Say so in the configuration."""
        fifo = {"priority": self.fifo, "lock_memory": True} if self.fifo else {}
        return fifo | ({"wake_us": 0} if self.awake else {})


class Live:
    """One run of everything."""

    def __init__(
        self, folder: Path, rate_hz: float, duration_s: float, scheduling: Scheduling
    ) -> None:
        self.rate_hz, self.duration_s, self._scheduling = rate_hz, duration_s, scheduling
        fifo = scheduling.fifo
        # The sender stands for the wire; who hears is any program.
        self._above, self._below = (fifo + 1, fifo - 1) if fifo else (0, 0)
        self._folder = folder
        self.bare = self._bare(min(30.0, duration_s / 2.0))
        self._prepare()
        self.usage: list[Usage] = []
        with ExitStack() as stack:
            self._play(stack)
        self._match()

    def _bare(self, seconds: float) -> dict[str, Times]:
        endpoint = _endpoint()
        rate, length, fifo = str(self.rate_hz), str(seconds), self._scheduling.fifo
        with _end(self._folder, "hear", fifo, endpoint) as heard:
            with _end(self._folder, "publish", fifo, endpoint, rate, length) as publisher:
                publisher.wait_done()
            heard.stop()
        with _end(self._folder, "two-hops", fifo, rate, length, str(fifo)) as hops:
            hops.wait_done()
        under_way = heard.rows(2)
        return {
            "two bare SOCK_SEQPACKET hops": hops.rows(1)[:, 0],
            "bare Zenoh": under_way[under_way[:, 0] == 0, 1],
            "published as by the gateway": under_way[under_way[:, 0] == 1, 1],
        }

    def _prepare(self) -> None:
        """Write the capture that is played, and the configuration that goes with it."""
        demo = twin.load(twin.DEMO)
        devices = dict(demo.devices)
        replace = msgspec.structs.replace
        devices["imu0"] = replace(devices["imu0"], rate_hz=self.rate_hz)
        clock = replace(devices["usbl0"].clock, latency_ms=LATE_S * 1e3)
        devices["usbl0"] = replace(devices["usbl0"], period_s=EVERY_S, clock=clock)
        for name in devices:
            port = twin.UdpPort(port=_free_port(socket.SOCK_DGRAM))
            devices[name] = replace(devices[name], port=port)
        scenario = replace(demo, devices=devices, duration_s=self.duration_s + SKIPPED_S)
        emulate(scenario, pcap=self._folder / "live.pcap", say=lambda _line: None)
        self._endpoint, self._nmea_port = _endpoint(), _free_port(socket.SOCK_DGRAM)
        nmea = {
            "type": "nmea",
            "link": {"type": "udp", "port": self._nmea_port},
            "sentences": ["RMC", "GGA"],
            "rate_hz": min(NMEA_HZ, self.rate_hz / 2),
        }
        # Above the rate of the IMU, so that each sample has its solution.
        rate_hz = 4.0 * self.rate_hz
        listen = [self._endpoint]
        outputs = [nmea, {"type": "zenoh", "mode": "peer", "listen": listen, "rate_hz": rate_hz}]
        config = twin.gateway_config(scenario) | {"outputs": outputs}
        if realtime := self._scheduling.realtime():
            config["realtime"] = realtime
        self._config = self._folder / "config.yaml"
        self._config.write_text(yaml.safe_dump(config))
        self._key = f"usblnav/{scenario.vehicle}/nav"

    def _play(self, stack: ExitStack) -> None:
        gateway = stack.enter_context(
            _gateway(self._config, self._folder, self._scheduling.niceness)
        )
        zenoh = stack.enter_context(
            _end(self._folder, "hear-zenoh", self._below, self._endpoint, self._key)
        )
        nmea = stack.enter_context(
            _end(self._folder, "hear-nmea", self._below, str(self._nmea_port))
        )
        capture = str(self._folder / "live.pcap")
        sender = stack.enter_context(
            _end(self._folder, "send", self._above, str(self._config), capture)
        )
        while (worker := _ask(self._config)["filter"]["pid"]) is None:  # a status of before
            time.sleep(0.1)
        self.usage = [Usage("daemon", gateway.pid), Usage("filter process", worker)]
        while sender.process.poll() is None:
            time.sleep(1.0)
            for usage in self.usage:
                usage.look()
        self.status = _ask(self._config)
        zenoh.stop()
        nmea.stop()
        sent = sender.rows(3)
        self._frames, self._fixes = sent[sent[:, 2] == 0], sent[sent[:, 2] == 1, 0]
        self._zenoh, self._nmea = zenoh.rows(2), nmea.rows(2)

    def _match(self) -> None:
        """Give each solution the frame that it is of: by time of validity, which is regular."""
        begin = self._frames[0, 0] + round(SKIPPED_S * 1e9)
        valid = self._zenoh[:, 1]
        # A sample is of the declared latency before its frame, as the least delayed frames go.
        delay = np.quantile(self._frames[:, 0] - self._frames[:, 1], 0.02)
        frame, off = _match(self._frames[:, 1], valid + IMU_LATENCY_NS - round(delay))
        assert np.median(off) < 0.25e9 / self.rate_hz
        keep = self._frames[frame, 0] >= begin
        self.heard = self._zenoh[keep, 0]
        self.arrived = self._frames[frame[keep], 0]
        self.zenoh_ns = self.heard - self.arrived
        self.missing = len(self._frames[self._frames[:, 0] >= begin]) - len(set(frame[keep]))
        # An epoch's time is rounded to 10 ms; it is that of the first solution from there on.
        first = np.minimum(np.searchsorted(valid, self._nmea[:, 1]), len(valid) - 1)
        keep = (np.abs(valid[first] - self._nmea[:, 1]) < 1.1e9 / self.rate_hz) & (
            self._frames[frame[first], 0] >= begin
        )
        self.nmea_arrived = self._frames[frame[first[keep]], 0]
        self.nmea_ns = self._nmea[keep, 0] - self.nmea_arrived

    def rows(self) -> Iterator[dict[str, Any]]:
        """The table: milliseconds."""
        for name, ns in self.bare.items():
            yield _row(name, ns)
        to = {"Zenoh": (self.zenoh_ns, self.arrived), "NMEA": (self.nmea_ns, self.nmea_arrived)}
        for output, (ns, arrived) in to.items():
            yield _row(f"arrival to {output}", ns)
            for when, chosen in self._around(arrived):
                yield _row(f"  {when} a fix", ns[chosen])
        interval = np.diff(self.heard)
        yield _row("interval on Zenoh", interval)
        for when, chosen in self._around(self.arrived[1:]):
            yield _row(f"  {when} a fix", interval[chosen])

    def _around(self, t: Times) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        """Which of the times lie before, during and after a fix's arrival."""
        last = np.searchsorted(self._fixes, t, side="right") - 1
        since = np.where(last >= 0, t - self._fixes[last], 10**12) * 1e-9
        following = np.minimum(last + 1, len(self._fixes) - 1)
        ahead = (self._fixes[following] - t) * 1e-9
        yield "before", (ahead > 0.0) & (ahead <= BEFORE_S)
        yield "during", since < DURING_S
        yield "after", (since >= DURING_S) & (since < DURING_S + AFTER_S)


class Usage:
    """Processor time and resident memory of a process, once a second."""

    def __init__(self, name: str, pid: int) -> None:
        self.name, self._pid = name, pid
        self._looks: list[tuple[float, float, float]] = []
        self.look()

    def look(self) -> None:
        """Note what it has used."""
        here = Path(f"/proc/{self._pid}")
        # To the nanosecond; the ticks of `stat` mistake a process that is woken by timers.
        threads = [(task / "schedstat").read_text() for task in (here / "task").iterdir()]
        seconds = sum(int(text.split()[0]) for text in threads) * 1e-9
        pages = int((here / "statm").read_text().split()[1])
        resident = pages * os.sysconf("SC_PAGE_SIZE") / 2**20
        self._looks.append((time.monotonic(), seconds, resident))

    def report(self) -> dict[str, Any]:
        """Share of a core; memory at start and end, and its slope once the history is full."""
        t, seconds, resident = np.array(self._looks).T
        settled = t >= t[0] + min(FULL_S, (t[-1] - t[0]) / 2)
        slope = np.polyfit(t[settled], resident[settled], 1)[0] * 3600.0
        return {
            "process": self.name,
            "cpu_percent": round(float((seconds[-1] - seconds[0]) / (t[-1] - t[0])) * 100.0, 1),
            "resident_start_mb": round(float(resident[0]), 1),
            "resident_end_mb": round(float(resident[-1]), 1),
            "slope_mb_h": round(float(slope), 2),
        }


class End:
    """One process of `tests.bench.ends`, ready."""

    def __init__(self, process: "subprocess.Popen[bytes]", out: Path) -> None:
        self.process, self._out = process, out

    def wait_done(self) -> None:
        """Wait until it has done its work."""
        assert self.process.wait() == 0

    def stop(self) -> None:
        """Tell it that this was all."""
        assert self.process.stdin is not None
        time.sleep(0.3)  # the last ones are under way
        self.process.stdin.close()
        self.wait_done()

    def rows(self, columns: int) -> Times:
        """Its stamps."""
        return np.fromfile(self._out, dtype=np.int64).reshape(-1, columns)


@contextmanager
def _end(folder: Path, role: str, fifo: int, *arguments: str) -> Iterator[End]:
    out = folder / role
    command = [sys.executable, "-m", "tests.bench.ends", role, str(out), str(fifo), *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == b"ready\n", role
            yield End(process, out)
        finally:
            process.kill()


@contextmanager
def _gateway(config: Path, folder: Path, niceness: int) -> Iterator["subprocess.Popen[bytes]"]:
    """`usblnav run`, ready."""
    address = str(folder / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        command = ["nice", f"--adjustment={niceness}", sys.executable]
        command += ["-m", "gateway", "run", "-c", str(config)]
        environment = os.environ | {"NOTIFY_SOCKET": address}
        with subprocess.Popen(command, cwd=ROOT, env=environment) as process:
            try:
                while manager.recv(4096) != b"READY=1":
                    pass
                yield process
            finally:
                process.terminate()


def _ask(config: Path) -> dict[str, Any]:
    """The gateway's status."""
    command = [sys.executable, "-m", "gateway", "status", "-c", config, "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    status: dict[str, Any] = json.loads(done.stdout)
    return status


def _match(frames: Times, t: Times) -> tuple[NDArray[np.intp], Times]:
    """Index of the frame nearest to each time, and how far off it is."""
    after = np.clip(np.searchsorted(frames, t), 1, len(frames) - 1)
    index = np.where(t - frames[after - 1] < frames[after] - t, after - 1, after)
    return index, np.abs(frames[index] - t)


def _row(what: str, ns: Times) -> dict[str, Any]:
    names = ("p50", "p99", "p99_9", "max")
    values = np.quantile(ns, QUANTILES) / 1e6 if len(ns) else [np.nan] * 4
    times = {name: round(float(v), 3) for name, v in zip(names, values, strict=True)}
    return {"what": what, "count": len(ns), **times}


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _endpoint() -> str:
    return f"tcp/127.0.0.1:{_free_port(socket.SOCK_STREAM)}"


def main() -> None:
    """Run, and print a table or JSON."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.live", description=__doc__)
    parser.add_argument("--duration", type=float, default=SHORT_S, metavar="S")
    parser.add_argument("--rate", type=float, default=200.0, metavar="HZ", help="of the IMU")
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--fifo", action="store_const", const=FIFO, default=0, help=f"SCHED_FIFO {FIFO}"
    )
    how.add_argument("--nice", type=int, default=0, metavar="N", help="-10 as in the unit")
    parser.add_argument("--awake", action="store_true", help="cores kept awake (wake_us: 0)")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scheduling = Scheduling(arguments.fifo, arguments.nice, arguments.awake)
        run = Live(Path(folder), arguments.rate, arguments.duration, scheduling)
    rows, usage = list(run.rows()), [usage.report() for usage in run.usage]
    head = {"rate_hz": run.rate_hz, "fixes": len(run._fixes), "missing": run.missing}
    p99 = {row["what"]: row["p99"] for row in rows}
    head["published_over_bare_p99"] = round(
        p99["published as by the gateway"] / p99["bare Zenoh"], 2
    )
    if arguments.json:
        print(json.dumps(head | {"ms": rows, "usage": usage, "status": run.status}))
        return
    load = os.getloadavg()[0]
    print(f"{head}, {scheduling}, {os.cpu_count()} cores, load {load:.1f}")
    print(f"{'ms':30}{'count':>9}{'50 %':>9}{'99 %':>9}{'99.9 %':>9}{'max':>9}")
    for row in rows:
        times = "".join(f"{row[key]:9.3f}" for key in ("p50", "p99", "p99_9", "max"))
        print(f"{row['what']:30}{row['count']:9}{times}")
    for entry in usage:
        print(entry)
    for row in run.status["latency"]:
        recent = row["recent"]
        times = "".join(
            f"{recent[k] / 1e3:9.3f}" for k in ("p50_us", "p99_us", "p99_9_us", "max_us")
        )
        print(f"{row['stage'] + ' ' + row['of']:30}{recent['count']:9}{times}")


if __name__ == "__main__":
    main()
