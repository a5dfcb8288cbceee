"""`usblnav run`: the daemon."""

import resource
from argparse import Namespace

from drivers.settings import StdioLink
from gateway.config import Config, NmeaOutput, load
from gateway.errors import ConfigError, UsblnavError
from gateway.filter_process.launcher import begin
from gateway.outputs.checks import output_faults

FILES, FEWEST_FILES = 1024, 256
"""Open files to ask for, and without which sockets fail one by one: Zenoh takes some 50."""


def run(arguments: Namespace) -> int:
    """Navigate until told to stop."""
    config = load(arguments.config)
    if faults := list(output_faults(config)):
        raise ConfigError(faults, arguments.config)
    on_stdout = arguments.nmea == "-"
    if on_stdout and _writes_stdout(config):
        raise ConfigError("--nmea -: standard output is already used by an output of the file")
    _ask_for_files()
    begun = begin()
    from gateway import daemon  # meanwhile: both take a second to import what they need

    daemon.run(config, nmea_stdout=on_stdout, cold=arguments.cold, begun=begun)
    return 0


def _ask_for_files() -> None:
    """Raise the limit of open files where it is low, as far as that is permitted."""
    permitted, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    unlimited = resource.RLIM_INFINITY
    if permitted != unlimited and permitted < FILES:
        permitted = FILES if most == unlimited else min(FILES, most)
        resource.setrlimit(resource.RLIMIT_NOFILE, (permitted, most))
    if permitted != unlimited and permitted < FEWEST_FILES:
        needed = f"{FEWEST_FILES} are needed (ulimit -n, LimitNOFILE= of the unit)"
        raise UsblnavError(f"{permitted} open files are permitted; {needed}")


def _writes_stdout(config: Config) -> bool:
    return any(
        isinstance(output, NmeaOutput) and isinstance(output.link, StdioLink)
        for output in config.outputs
    )
