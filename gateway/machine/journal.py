"""The log on standard error, which a reader that has stopped reading cannot hold up."""

import logging
import os
import select
from contextlib import suppress


class PatientHandler(logging.Handler):
    """Writes lines as long as they are taken; those that are not are counted, and that is said.

    Standard error stays in blocking mode, for others share it. What is ready takes ``PIPE_BUF``
    bytes without waiting, so asking `poll` first is enough.
    """

    def __init__(self, fd: int = 2) -> None:
        super().__init__()
        self._fd = fd
        self._poll = select.poll()
        self._poll.register(fd, select.POLLOUT)
        self.dropped = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, unless nobody takes it."""
        text = self.format(record)
        if self.dropped:
            text += f" ({self.dropped} lines before it were lost: nobody read)"
        if self._write(text.encode(errors="backslashreplace") + b"\n"):
            self.dropped = 0
        else:
            self.dropped += 1

    def _write(self, data: bytes) -> bool:
        """Hand on what is taken at once; whether that was all."""
        with suppress(OSError):
            while data and self._poll.poll(0):
                data = data[os.write(self._fd, data[: select.PIPE_BUF]) :]
        return not data


def open_journal() -> None:
    """Send what the program logs to standard error."""
    handler = PatientHandler()
    handler.setFormatter(logging.Formatter("usblnav: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
