"""Errors a user can cause; each becomes one clear line and an exit code, never a traceback."""

from pathlib import Path


class UsblnavError(Exception):
    """Something failed while running: one line that says what and where (exit code 1)."""

    exit_code = 1


class ConfigError(UsblnavError):
    """Unusable arguments or configuration (exit code 2).

    ``faults`` holds every problem found, ``file`` the file they stand in; as text, a line for each.
    """

    exit_code = 2

    def __init__(self, faults: list[str] | str, file: Path | None = None) -> None:
        self.faults = [faults] if isinstance(faults, str) else faults
        self.file = file
        prefix = f"{file}: " if file else ""
        super().__init__("\n".join(prefix + fault for fault in self.faults))


def cause(error: OSError) -> str:
    """What the system says, as it stands in a line of ours."""
    return (error.strerror or str(error)).lower()
