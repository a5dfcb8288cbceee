"""The command as a user meets it: a real process, its output, its exit code, never a traceback."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import dpkt
import pytest

from drivers import registry
from gateway.emulator.twin import DEMO
from tests.gateway.command_line import FRAMES, USBLNAV, lines, usblnav
from tests.gateway.configurations import EVERY_FAULT, EVERY_KIND
from tests.loopback import free_endpoint
from tests.shared_data import ROOT

COMMANDS = [
    "run",
    "status",
    "monitor",
    "demo",
    "replay",
    "export",
    "report",
    "emulate",
    "check",
    "codecs",
    "decode",
    "study",
]


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    path = tmp_path / "wrong.yaml"
    path.write_text(EVERY_KIND)
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    done = usblnav(command, "--help")
    assert done.returncode == 0
    assert done.stdout.startswith(f"usage: usblnav {command} ".encode())


def test_help_lists_every_command() -> None:
    text = usblnav("--help").stdout.decode()
    assert re.findall(r"^    (\w+) ", text, re.MULTILINE) == COMMANDS


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["navigate"],
        ["run"],
        ["demo", "--duration", "0"],
        ["demo", "--duration", "nan"],
        ["demo", "--duration", "soon"],
        ["replay", "x.pcap", "-c", "config.yaml"],
        ["decode", "-"],
    ],
)
def test_unusable_arguments_end_with_2(arguments: Sequence[str]) -> None:
    done = usblnav(*arguments)
    assert done.returncode == 2
    assert lines(done.stderr)[0].startswith("usage: usblnav")
    assert done.stdout == b""


@pytest.mark.parametrize(
    "command",
    [["check"], ["run", "-c"], ["replay", "x.pcap", "-o", "out", "-c"]],
    ids=["check", "run", "replay"],
)
def test_wrong_configuration_names_every_fault(command: list[str], wrong: Path) -> None:
    done = usblnav(*command, wrong)
    assert done.returncode == 2
    assert lines(done.stderr) == [f"{wrong}: {fault}" for fault in EVERY_FAULT]
    assert done.stdout == b""


def test_check_as_json(wrong: Path) -> None:
    done = usblnav("check", wrong, "--json")
    assert done.returncode == 2
    said = {"file": str(wrong), "ok": False, "faults": EVERY_FAULT, "advice": []}
    assert json.loads(done.stdout) == said
    good = usblnav("check", "config.yaml", "--json")
    assert good.returncode == 0
    said = {"file": "config.yaml", "ok": True, "faults": [], "advice": []}
    assert json.loads(good.stdout) == said


def test_check_of_a_good_file_shows_what_it_sets_up() -> None:
    done = usblnav("check", "config.yaml")
    assert done.returncode == 0
    assert lines(done.stdout) == [
        "config.yaml: no faults",
        "  imu0: kvh1750 on UDP 127.0.0.1:7001",
        "  usbl0: tracklink-lxt on /tmp/usblnav-usbl0 at 9600 baud",
        "  beacons: 1",
        "  output: NMEA 0183 to UDP 127.0.0.1:10110, 1 Hz",
        "  output: Zenoh usblnav/demo/, 10 Hz",
    ]


def test_a_file_name_may_be_any_bytes(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/\xff.yaml"
    Path(os.fsdecode(path)).write_bytes((ROOT / "config.yaml").read_bytes())
    done = usblnav("check", os.fsdecode(path))
    assert done.returncode == 0
    assert lines(done.stdout)[0].endswith("\\udcff.yaml: no faults")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check", "absent.yaml"], "absent.yaml: no such file or directory"),
        (["check", "docs"], "docs: is a directory"),
        (
            ["demo", "--filter", "right_invarient"],
            "usblnav: --filter: no filter is called right_invarient; did you mean right_invariant?",
        ),
        (
            ["replay", "absent.pcap", "-c", "config.yaml", "-o", "out"],
            "usblnav: absent.pcap: no such file or folder",
        ),
        (["emulate", "-c", "absent.yaml"], "absent.yaml: no such file or directory"),
        (
            ["emulate", "--pcap", "x.pcap", "--speed", "2"],
            "usblnav: --speed: a capture is written as fast as the machine can",
        ),
        (
            ["decode", "--codec", "kvh", "-"],
            'usblnav: --codec: no codec is called "kvh"; did you mean kvh1750?',
        ),
        (
            ["decode", "--codec", "kvh1750", "absent.bin"],
            "usblnav: absent.bin: no such file or directory",
        ),
        (["decode", "--codec", "kvh1750", "docs"], "usblnav: docs: is a directory"),
        (["decode", "--codec", "kvh1750"], "usblnav: FILE or --link: missing"),
        (
            ["decode", "--codec", "kvh1750", "--link", "udp:7001", "cable.bin"],
            "usblnav: --link: not together with FILE or --hex",
        ),
        (
            ["decode", "--codec", "kvh1750", "--raw", "x", "cable.bin"],
            "usblnav: --raw: only with --link",
        ),
        (
            ["decode", "--codec", "kvh1750", "--link", "udp:7001", "--raw", "config.yaml"],
            "usblnav: --raw: config.yaml: is there already",
        ),
    ],
)
def test_one_line_says_what_is_unusable(arguments: Sequence[str], said: str) -> None:
    done = usblnav(*arguments)
    assert done.returncode == 2
    assert lines(done.stderr)[-1] == said
    assert done.stdout == b""


def test_nmea_to_stdout_only_once(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    example = (ROOT / "config.yaml").read_text()
    path.write_text(example + "  - {type: nmea, link: {type: stdout}}\n")
    done = usblnav("run", "-c", path, "--nmea", "-")
    assert done.returncode == 2
    assert lines(done.stderr) == [
        "usblnav: --nmea -: standard output is already used by an output of the file"
    ]


def test_codecs_lists_every_format_with_its_options() -> None:
    listed = json.loads(usblnav("codecs", "--json").stdout)
    assert [entry["name"] for entry in listed] == registry.names()
    kvh = next(entry for entry in listed if entry["name"] == "kvh1750")
    assert kvh["kind"] == "imu"
    assert kvh["options"]["accel"] == {
        "expects": "one of delta_v_ft_s, delta_v_m_s, g",
        "required": False,
        "default": "g",
    }
    text = usblnav("codecs").stdout.decode()
    for name in registry.names():
        assert re.search(rf"^{re.escape(name)}  \(\w+(, with [\w, ]+)?\)$", text, re.MULTILINE)
    stdbin = next(entry for entry in listed if entry["name"] == "stdbin")
    assert {"dvl", "depth", "usbl"} <= set(stdbin["also"])


def test_a_reader_that_leaves_is_no_fault(tmp_path: Path) -> None:
    path = tmp_path / "long.bin"
    path.write_bytes(b"".join(FRAMES) * 20_000)
    with subprocess.Popen(
        [*USBLNAV, "decode", "--codec", "kvh1750", str(path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
    ) as process:
        assert process.stdout and process.stderr
        assert process.stdout.readline().startswith(b'{"record":"imu"')
        process.stdout.close()
        assert process.wait(60) == 0
        assert b"Error" not in process.stderr.read()


def test_a_full_disk_is_one_line() -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full here")
    with full.open("wb") as sink:
        done = subprocess.run(
            [*USBLNAV, "codecs"],
            stdout=sink,
            stderr=subprocess.PIPE,
            cwd=ROOT,
            timeout=60,
            check=False,
        )
    assert done.returncode == 1
    assert lines(done.stderr) == ["usblnav: no space left on device"]


@pytest.mark.parametrize("arguments", [["--version"], ["check", "config.yaml"], ["codecs"]])
def test_light_commands_import_nothing_heavy(arguments: list[str]) -> None:
    heavy = {"numpy", "scipy", "numba", "zenoh", "serial", "rich", "asyncio"}
    code = (
        "import atexit, sys\n"
        f"atexit.register(lambda: sys.stderr.write(repr(sorted(set(sys.modules) & {heavy}))))\n"
        f"from gateway.cli import main\nsys.exit(main({arguments}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, cwd=ROOT, timeout=60, check=True
    )
    assert done.stderr == b"[]"


def test_emulate_writes_a_capture(tmp_path: Path) -> None:
    scenario, capture = tmp_path / "short.yaml", tmp_path / "short.pcap"
    text = re.sub(r"duration_s: \d+", "duration_s: 2", DEMO.read_text())
    scenario.write_text(text)
    truth = tmp_path / "truth.csv"
    done = usblnav("emulate", "-c", scenario, "--pcap", capture, "--truth", truth)
    assert done.returncode == 0, done.stderr.decode()
    with capture.open("rb") as file:
        ports = [
            dpkt.ethernet.Ethernet(packet).ip.udp.dport for _, packet in dpkt.pcap.Reader(file)
        ]
    counted = dict(re.findall(r"^(\w+): (\d+) frames", done.stdout.decode(), re.MULTILINE))
    assert int(counted["imu0"]) == ports.count(7001) == 400
    assert len(truth.read_text().splitlines()) > 2


def test_status_of_nobody_is_one_line(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    done = usblnav("status", "--connect", endpoint)
    assert (done.returncode, done.stdout) == (1, b"")
    assert lines(done.stderr) == [f"usblnav: zenoh {endpoint}: nobody answers"]
    silent = tmp_path / "config.yaml"
    silent.write_text((ROOT / "config.yaml").read_text().partition("\noutputs:")[0])
    done = usblnav("status", "-c", str(silent))
    assert (done.returncode, done.stdout) == (2, b"")
    fault = "outputs: none is of type zenoh, which is what is asked"
    assert lines(done.stderr) == [f"{silent}: {fault}"]


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_streams_that_the_caller_has_closed_are_no_numbers_for_sockets(
    closed: str, tmp_path: Path
) -> None:
    code = """
import os, socket, sys
from gateway import cli
code = cli.main(["check", "config.yaml"])
with socket.socket() as line, open(sys.argv[1], "w") as told:
    child = os.spawnv(os.P_WAIT, "/bin/sh", ["sh", "-c", "true <&0 >&1 2>&1"])
    print(code, line.fileno() > 2, child, file=told)
"""
    told = tmp_path / "told"
    done = subprocess.run(
        ["/bin/sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", code, told],
        cwd=ROOT,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0
    assert told.read_text() == "0 True 0\n"


def test_too_few_open_files_are_said_before_anything_fails() -> None:
    done = subprocess.run(
        ["/bin/sh", "-c", 'ulimit -n 20; exec "$@"', "sh", *USBLNAV, "run", "-c", "config.yaml"],
        capture_output=True,
        cwd=ROOT,
        timeout=60,
        check=False,
    )
    said = b"usblnav: 20 open files are permitted; 256 are needed"
    said += b" (ulimit -n, LimitNOFILE= of the unit)"
    assert (done.returncode, done.stderr) == (1, said + b"\n")
