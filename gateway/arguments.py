"""The words of the command line: commands, options, and what they must be."""

import argparse
import math
from importlib.metadata import version
from pathlib import Path
from typing import Any

FILTERS = ("right_invariant", "left_invariant", "additive", "loose")
STUDIES = (
    "relative-measurement",
    "propagation-delay",
    "radial-velocity",
    "invariant-small",
    "invariant-large",
    "invariant-semi",
)


def command_line() -> argparse.ArgumentParser:
    """The whole of it; parsing ends the process where the arguments are unusable."""
    parser = argparse.ArgumentParser(
        prog="usblnav",
        description="Inertial and USBL acoustic navigation in real time.",
        epilog="Exit codes: 0 done, 1 failed while running, 2 unusable arguments or configuration.",
    )
    parser.add_argument("--version", action="version", version=f"usblnav {version('usblnav')}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_run(commands)
    _add_status(commands)
    _add_monitor(commands)
    _add_demo(commands)
    _add_replay(commands)
    _add_export(commands)
    _add_report(commands)
    _add_emulate(commands)
    _add_check(commands)
    _add_codecs(commands)
    _add_decode(commands)
    _add_calibrate(commands)
    _add_study(commands)
    return parser


def _command(commands: Any, name: str, summary: str, more: str = "") -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=summary, description=f"{summary[0].upper()}{summary[1:]}. {more}".strip()
    )
    return parser


def _add_run(commands: Any) -> None:
    parser = _command(
        commands,
        "run",
        "navigate: read the devices, filter, publish, until SIGTERM or SIGINT",
    )
    _add_config(parser)
    parser.add_argument(
        "--nmea",
        choices=["-"],
        help="also write NMEA 0183 to standard output, to pipe it to anything",
    )
    parser.add_argument(
        "--cold",
        action="store_true",
        help="begin with the configured position, whatever the state file says",
    )


def _add_status(commands: Any) -> None:
    parser = _command(
        commands,
        "status",
        "ask a running gateway how it fares: devices, filter, outputs, latencies",
        "Asks over Zenoh, on this machine unless told otherwise.",
    )
    _add_asking(parser)
    _add_json(parser, "the status")


def _add_monitor(commands: Any) -> None:
    parser = _command(
        commands,
        "monitor",
        "watch a running gateway on the terminal, from any machine",
        "Shows solution, devices, fixes, outputs and alarms until Ctrl-C; into a pipe, one screen.",
    )
    _add_asking(parser)
    parser.add_argument("--vehicle", metavar="NAME", help="the one to show (default: the first)")
    parser.add_argument("--once", action="store_true", help="print one screen and end")


def _add_demo(commands: Any) -> None:
    parser = _command(
        commands,
        "demo",
        "navigate in the emulator: no hardware, no configuration",
        "Shows the live solution and ends with its error against the emulator's truth.",
    )
    parser.add_argument(
        "--duration",
        type=_positive,
        default=60.0,
        metavar="S",
        help="seconds to run (default: 60)",
    )
    parser.add_argument(
        "--filter",
        default="right_invariant",
        metavar="NAME",
        help="error definition of the filter (default: right_invariant)",
    )


def _add_replay(commands: Any) -> None:
    parser = _command(
        commands,
        "replay",
        "run captured or recorded traffic through the same pipeline, as fast as the machine can",
        "Writes nav.csv, innovations.csv, calibration.csv, residuals.csv and summary.json. "
        "The same input gives the same output.",
    )
    parser.add_argument(
        "captures",
        nargs="+",
        type=Path,
        metavar="CAPTURE",
        help="pcap or pcapng, each also gzipped; or a recording: its folder, or files of one run",
    )
    parser.add_argument(
        "-c",
        "--config",
        type=Path,
        metavar="CONFIG.yaml",
        help="configuration file (default: that of the recording)",
    )
    _add_out(parser)
    parser.add_argument(
        "--rate",
        type=_positive,
        metavar="HZ",
        help="solutions a second in nav.csv (default: 10, or as recorded)",
    )
    parser.add_argument(
        "--from",
        dest="origin",
        choices=["auto", "pcap", "pcapng", "recording"],
        default="auto",
        help="what the captures are (default: auto, by their first bytes)",
    )
    _add_filters(parser)
    _add_json(parser, "the summary")


def _add_filters(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--filters",
        type=_filters,
        default=[],
        metavar="NAME,...",
        help="error definitions to run side by side, each into OUT/NAME: "
        f"{', '.join(FILTERS)} (default: the configured one, into OUT)",
    )
    parser.add_argument(
        "--smooth",
        action="store_true",
        help="make each solution from all measurements, the later ones too",
    )


def _add_export(commands: Any) -> None:
    parser = _command(
        commands,
        "export",
        "write what a recording holds as the files of a replay",
        "Writes the live run's own nav.csv, innovations.csv and calibration.csv.",
    )
    parser.add_argument(
        "recordings",
        nargs="+",
        type=Path,
        metavar="RECORDING",
        help="a recording: its folder, or files of one run",
    )
    _add_out(parser)
    _add_json(parser, "the counts")


def _add_report(commands: Any) -> None:
    parser = _command(
        commands,
        "report",
        "one page of figures about a replay or a recording",
        "One HTML file that holds everything: track, sigmas, innovations, constants, devices.",
    )
    parser.add_argument(
        "results",
        nargs="+",
        type=Path,
        metavar="OUT",
        help="folder that a replay or an export wrote; or a recording: its folder or files",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FILE.csv",
        help="the true motion that `usblnav emulate --truth` wrote",
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="FILE.html", help="the page (default: OUT/report.html)"
    )


def _add_emulate(commands: Any) -> None:
    parser = _command(
        commands,
        "emulate",
        "play a scenario as real frames on ptys, serial ports, UDP or into a pcap",
    )
    parser.add_argument(
        "-c",
        "--config",
        type=Path,
        metavar="SCENARIO.yaml",
        help="scenario (default: the packaged demo)",
    )
    parser.add_argument(
        "--pcap", type=Path, metavar="FILE", help="write a capture instead of playing in real time"
    )
    parser.add_argument("--truth", type=Path, metavar="FILE.csv", help="write the true motion")
    parser.add_argument(
        "--gateway-config",
        type=Path,
        metavar="FILE.yaml",
        help="write the gateway's configuration that belongs to the scenario (or to the capture)",
    )
    parser.add_argument(
        "--duration", type=_positive, metavar="S", help="seconds (default: the scenario's)"
    )
    parser.add_argument(
        "--speed", type=_positive, default=1.0, metavar="X", help="times real time (default: 1)"
    )
    _add_json(parser, "what became of the frames")


def _add_check(commands: Any) -> None:
    parser = _command(
        commands,
        "check",
        "name every fault of a configuration file; opens no device",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG.yaml")
    _add_json(parser, "the faults")


def _add_codecs(commands: Any) -> None:
    parser = _command(commands, "codecs", "list the wire formats with their options")
    _add_json(parser, "the list")


def _add_decode(commands: Any) -> None:
    parser = _command(
        commands,
        "decode",
        "raw bytes to JSON lines, for looking at a cable before trusting it",
        "One object a record, what could not be decoded included; the totals go to standard error. "
        "t_rx_ns is the host's monotonic time for a line, pipe or device, and 0 for a file.",
    )
    parser.add_argument("--codec", required=True, metavar="NAME", help="see `usblnav codecs`")
    parser.add_argument(
        "-o",
        "--option",
        dest="options",
        action="append",
        default=[],
        metavar="key=value",
        help="an option of the codec; may be repeated",
    )
    parser.add_argument(
        "--hex", action="store_true", help="the input is hexadecimal text; white space is ignored"
    )
    parser.add_argument(
        "file", metavar="FILE", nargs="?", help="file or device to read; - for standard input"
    )
    parser.add_argument(
        "--link",
        metavar="LINK",
        help="listen to a line until Ctrl-C: serial:/dev/ttyUSB0:9600, udp:7001, udp:ADDRESS:PORT, "
        "tcp:HOST:PORT, or '{type: serial, ...}' as in the configuration",
    )
    parser.add_argument(
        "--raw", type=Path, metavar="FILE", help="also keep the bytes of the line in a new file"
    )


def _add_calibrate(commands: Any) -> None:
    parser = _command(
        commands,
        "calibrate",
        "what a replay says about the acoustic array, and what it cannot tell",
        "Prints mounting, offsets, sound speed, lever arm and latency with their sigmas; writes "
        "them, figures and the part of config.yaml to change into OUT/calibrate. Best after "
        "`usblnav replay --smooth`.",
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder that a replay wrote")
    parser.add_argument(
        "--figures",
        choices=["png", "svg", "none"],
        default="png",
        help="what the figures are written as (default: png)",
    )
    _add_json(parser, "the findings")


def _add_study(commands: Any) -> None:
    parser = _command(
        commands,
        "study",
        "reproduce a published table by seeded Monte Carlo in the emulator",
        "Prints published beside attained numbers with their 95 % bounds.",
    )
    parser.add_argument("name", choices=STUDIES, metavar="NAME", help=", ".join(STUDIES))
    parser.add_argument("--runs", type=_count, metavar="N", help="runs (default: 50)")
    parser.add_argument(
        "--jobs", type=_count, default=-1, metavar="N", help="processes (default: one a core)"
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="OUT", help="folder for the figures and the table"
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="run on the cluster of this dask scheduler, such as tcp://10.0.0.1:8786",
    )
    _add_json(parser, "the table")


def _add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-c", "--config", required=True, type=Path, metavar="CONFIG.yaml", help="configuration file"
    )


def _add_asking(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-c", "--config", type=Path, metavar="CONFIG.yaml", help="the gateway's configuration file"
    )
    parser.add_argument(
        "--connect", metavar="ENDPOINT", help="where to ask, such as tcp/192.168.1.10:7447"
    )


def _add_out(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--out", required=True, type=Path, metavar="OUT", help="folder for the results"
    )


def _add_json(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--json", action="store_true", help=f"print {what} as JSON")


def _filters(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in FILTERS:
            raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(FILTERS)}")
    return list(dict.fromkeys(names))


def _positive(text: str) -> float:
    value = float(text)
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"expected a number > 0, got {text}")
    return value


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number > 0, got {text}")
    return int(text)
