"""The command line: one command run, its exit code, and one line for whatever goes wrong."""

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper

from gateway.arguments import command_line
from gateway.errors import ConfigError, UsblnavError, cause

INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv
        Arguments without the program's name; those of the process when None.

    Returns
    -------
    Exit code: 0 done, 1 failed while running, 2 unusable arguments or configuration, 130
    interrupted.
    """
    _stand_in()
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file name may be any bytes
    arguments = command_line().parse_args(argv)
    try:
        # Each command is a module, imported on use: `check` and `--help` need no numpy.
        code: int = import_module(f"gateway.commands.{arguments.command}").run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        _abandon_stdout()  # whoever read us has seen enough
        return 0
    except ConfigError as error:
        prefix = error.file or "usblnav"
        _complain("\n".join(f"{prefix}: {fault}" for fault in error.faults))
        return error.exit_code
    except UsblnavError as error:
        _complain(f"usblnav: {error}")
        return error.exit_code
    except OSError as error:
        _abandon_stdout()
        place = f"{error.filename}: " if error.filename else ""
        _complain(f"usblnav: {place}{cause(error)}")
        return 1
    return code


def _stand_in() -> None:
    """Let standard streams that the caller has closed lead nowhere.

    Else the next socket would have their number, and be written to.
    """
    for fd, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        with suppress(OSError):
            os.fstat(fd)
            continue  # meanwhile it is another's
        nowhere = os.open(os.devnull, os.O_RDWR)
        os.set_inheritable(nowhere, True)
        setattr(sys, name, os.fdopen(nowhere, "w" if fd else "r", closefd=False))


def _complain(text: str) -> None:
    with suppress(OSError):
        sys.stderr.write(text + "\n")
        sys.stderr.flush()


def _abandon_stdout() -> None:
    """Let the interpreter's last flush go nowhere, else it complains by itself."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
