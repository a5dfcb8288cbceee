"""A command under the system call filter of a unit, as systemd would lay it on, without a boot.

Run as ``python -m tests.callfilter [--without CALL] UNIT COMMAND ...``.
"""

import argparse
import ctypes
import ctypes.util
import errno
import os
import subprocess
import sys
from pathlib import Path

ALLOW, ERRNO = 0x7FFF0000, 0x00050000
"""Of libseccomp: SCMP_ACT_ALLOW and SCMP_ACT_ERRNO(0)."""


def members(name: str) -> set[str]:
    """The calls of a set (`@process`), those of the sets in it too; or the call itself."""
    if not name.startswith("@"):
        return {name}
    done = subprocess.run(
        ["systemd-analyze", "syscall-filter", name], capture_output=True, text=True, check=True
    )
    lines = [line.strip() for line in done.stdout.splitlines()[1:]]
    return set().union(*(members(line) for line in lines if line and not line.startswith("#")))


def permitted(unit: str) -> set[str]:
    """What a unit permits, whose first ``SystemCallFilter=`` names what is permitted."""
    calls = members("@default")
    for line in unit.splitlines():
        if line.startswith("SystemCallFilter="):
            words = line.partition("=")[2]
            named = set().union(*(members(word) for word in words.removeprefix("~").split()))
            calls = calls - named if words.startswith("~") else calls | named
    return calls


def lay_on(calls: set[str]) -> None:
    """Deny this process, and all that it starts, every other call (EPERM)."""
    seccomp = ctypes.CDLL(ctypes.util.find_library("seccomp"))
    seccomp.seccomp_init.restype = ctypes.c_void_p
    context = ctypes.c_void_p(seccomp.seccomp_init(ctypes.c_uint32(ERRNO | errno.EPERM)))
    for call in calls:
        number = seccomp.seccomp_syscall_resolve_name(call.encode())
        seccomp.seccomp_rule_add(context, ctypes.c_uint32(ALLOW), number, 0)
    if seccomp.seccomp_load(context) != 0:
        sys.exit("the system call filter cannot be laid on")


def main() -> None:
    """Lay the filter on and become the command."""
    parser = argparse.ArgumentParser()
    parser.add_argument("unit", type=Path)
    parser.add_argument("--without", action="append", default=[])
    parser.add_argument("command", nargs=argparse.REMAINDER)
    given = parser.parse_args()
    lay_on(permitted(given.unit.read_text()) - set(given.without))
    os.execvp(given.command[0], given.command)


if __name__ == "__main__":
    main()
