"""`usblnav run`: the daemon."""

from argparse import Namespace

from drivers.settings import StdioLink
from gateway.config import Config, NmeaOutput, load
from gateway.errors import ConfigError


def run(arguments: Namespace) -> int:
    """Navigate until told to stop."""
    config = load(arguments.config)
    on_stdout = arguments.nmea == "-"
    if on_stdout and _writes_stdout(config):
        raise ConfigError("--nmea -: standard output is already used by an output of the file")
    from gateway import daemon  # after the check: it takes a second to import

    daemon.run(config, nmea_stdout=on_stdout, cold=arguments.cold)
    return 0


def _writes_stdout(config: Config) -> bool:
    return any(
        isinstance(output, NmeaOutput) and isinstance(output.link, StdioLink)
        for output in config.outputs
    )
