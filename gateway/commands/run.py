"""`usblnav run`: the daemon."""

from argparse import Namespace

from drivers.settings import StdioLink
from gateway.config import Config, NmeaOutput, load
from gateway.errors import ConfigError
from gateway.filter_process.launcher import begin
from gateway.outputs.checks import output_faults


def run(arguments: Namespace) -> int:
    """Navigate until told to stop."""
    config = load(arguments.config)
    if faults := list(output_faults(config)):
        raise ConfigError(faults, arguments.config)
    on_stdout = arguments.nmea == "-"
    if on_stdout and _writes_stdout(config):
        raise ConfigError("--nmea -: standard output is already used by an output of the file")
    begun = begin()
    from gateway import daemon  # meanwhile: both take a second to import what they need

    daemon.run(config, nmea_stdout=on_stdout, cold=arguments.cold, begun=begun)
    return 0


def _writes_stdout(config: Config) -> bool:
    return any(
        isinstance(output, NmeaOutput) and isinstance(output.link, StdioLink)
        for output in config.outputs
    )
