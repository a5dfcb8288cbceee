"""The daemon of a command line, by its configuration."""

from argparse import Namespace

from drivers.settings import StdioLink
from gateway import daemon
from gateway.config import Config, NmeaOutput, load
from gateway.errors import ConfigError
from gateway.filter_process.begun import Begun
from gateway.outputs.checks import output_faults


def run(arguments: Namespace, begun: Begun) -> None:
    """Navigate until told to stop."""
    config = load(arguments.config)
    if faults := list(output_faults(config)):
        raise ConfigError(faults, arguments.config)
    on_stdout = arguments.nmea == "-"
    if on_stdout and _writes_stdout(config):
        raise ConfigError("--nmea -: standard output is already used by an output of the file")
    daemon.run(config, nmea_stdout=on_stdout, cold=arguments.cold, begun=begun)


def _writes_stdout(config: Config) -> bool:
    return any(
        isinstance(output, NmeaOutput) and isinstance(output.link, StdioLink)
        for output in config.outputs
    )
