"""Errors a user can cause; each becomes one clear line and an exit code, never a traceback."""


class UsblnavError(Exception):
    """Something failed while running: one line that says what and where (exit code 1)."""

    exit_code = 1


class ConfigError(UsblnavError):
    """Unusable arguments or configuration; `faults` holds every problem found (exit code 2)."""

    exit_code = 2

    def __init__(self, faults: list[str] | str) -> None:
        self.faults = [faults] if isinstance(faults, str) else faults
        super().__init__("\n".join(self.faults))
