"""`usblnav run`: the daemon, and before all else its filter process, which takes longest."""

import resource
from argparse import Namespace

from gateway.errors import UsblnavError
from gateway.filter_process.begun import begin

FILES, FEWEST_FILES = 1024, 256
"""Open files to ask for, and without which sockets fail one by one: Zenoh takes some 50."""


def run(arguments: Namespace) -> int:
    """Navigate until told to stop."""
    _ask_for_files()
    begun = begin()
    try:
        from gateway.commands import running  # meanwhile: both take a second to import all

        running.run(arguments, begun)
    finally:
        begun.end()
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
