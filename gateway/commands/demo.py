"""`usblnav demo`: the daemon in the emulator."""

from argparse import Namespace
from typing import get_args, get_type_hints

from gateway.config import Filter
from gateway.errors import ConfigError
from gateway.schema import suggest


def run(arguments: Namespace) -> int:
    """Navigate the packaged scenario for a while."""
    name = arguments.filter
    names = get_args(get_type_hints(Filter)["error"])
    if name not in names:
        raise ConfigError(f"--filter: no filter is called {name}; {suggest(name, names)}")
    from gateway import demo  # after the check: it takes a second to import

    demo.run(arguments.duration, name)
    return 0
