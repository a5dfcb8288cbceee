"""`usblnav check`: every fault of a configuration file, or what it sets up."""

import json
from argparse import Namespace
from collections.abc import Iterator

from drivers.settings import OutputLink, PtyLink, SerialLink, StdioLink, TcpLink, UdpLink
from gateway.config import Config, NmeaOutput, doubts, load
from gateway.config.lines import advice
from gateway.errors import ConfigError
from gateway.outputs.checks import missing_files, output_faults


def run(arguments: Namespace) -> int:
    """Check the file; faults go to standard error, or to standard output as JSON."""
    try:
        config = load(arguments.config)
        if faults := [*output_faults(config), *missing_files(config)]:
            raise ConfigError(faults, arguments.config)
    except ConfigError as error:
        if not arguments.json:
            raise
        _print_json(arguments.config, error.faults, [])
        return error.exit_code
    advised = [*doubts(config), *advice(config)]
    if arguments.json:
        _print_json(arguments.config, [], advised)
    else:
        print(f"{arguments.config}: no faults")
        for line in _overview(config):
            print(f"  {line}")
        for line in advised:
            print(f"  advice: {line}")
    return 0


def _print_json(file: object, faults: list[str], advised: list[str]) -> None:
    report = {"file": str(file), "ok": not faults, "faults": faults, "advice": advised}
    print(json.dumps(report, indent=2))


def _overview(config: Config) -> Iterator[str]:
    for names in config.lines:
        device = config.devices[names[0]]
        yield f"{', '.join(names)}: {device.codec} on {_place(device.link, incoming=True)}"
    if config.beacons:
        yield f"beacons: {', '.join(config.beacons)}"
    for output in config.outputs:
        if isinstance(output, NmeaOutput):
            where = _place(output.link, incoming=False)
            yield f"output: NMEA 0183 to {where}, {output.rate_hz:g} Hz"
        else:
            yield f"output: Zenoh usblnav/{config.vehicle}/, {output.rate_hz:g} Hz"


def _place(link: OutputLink, *, incoming: bool) -> str:
    match link:
        case SerialLink():
            return f"{link.port} at {link.baud} baud{_framing(link)}"
        case UdpLink():
            return f"UDP {link.group or link.bind if incoming else link.host}:{link.port}"
        case TcpLink():
            return f"TCP {link.host if incoming else link.bind}:{link.port}"
        case PtyLink():
            return f"the pty {link.symlink}"
        case StdioLink():
            return "standard output"


def _framing(link: SerialLink) -> str:
    """What is not eight data bits, no parity, one stop bit."""
    short = f"{link.data_bits}{link.parity[0].upper()}{link.stop_bits}"
    words = [] if short == "8N1" else [short]
    words += [] if link.flow == "none" else [link.flow.upper().replace("_", "/")]
    words += [] if link.rs485 is None else ["RS-485"]
    return "".join(f", {word}" for word in words)
