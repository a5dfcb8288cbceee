"""Pseudo terminals out: a serial line without a wire, found under a name that stays."""

import errno
import os
import select
import termios
import tty
from contextlib import suppress
from pathlib import Path


class Pty:
    """The near end of a pseudo terminal, whose far end stands under a symlink.

    Attributes
    ----------
    name, target
        The symlink, and the device it points at.

    Raises
    ------
    OSError
        Where there can be none, or where something else stands under the name.
    """

    def __init__(self, symlink: str) -> None:
        self.name = symlink
        self._link = Path(symlink)
        self._near, far = os.openpty()
        os.set_blocking(self._near, False)
        self.target = os.ttyname(far)
        try:
            # Any program of this machine may read; what it writes is not listened to.
            os.fchmod(far, 0o666)
            tty.setraw(far)
            self._point_link()
        except (OSError, termios.error):
            os.close(self._near)
            raise
        finally:
            os.close(far)
        self._poll = select.poll()
        self._poll.register(self._near, 0)

    @property
    def has_reader(self) -> bool:
        """Whether a program holds the far end open."""
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def put(self, data: bytes) -> int:
        """Give what goes at once, and say how many bytes that were; none without a reader.

        Without that look a later reader would find old bytes waiting, as on no real line.
        """
        if not self.has_reader:
            return 0
        with suppress(OSError):
            return os.write(self._near, data)
        return 0

    def ignore_input(self) -> None:
        """Throw away what the reader has written, such as a probe of gpsd."""
        with suppress(OSError):
            while os.read(self._near, 4096):
                pass

    def forget_unread(self) -> None:
        """Throw away what the last reader has left, and undo how it set the line."""
        with suppress(OSError, termios.error):
            termios.tcflush(
                self._near, termios.TCOFLUSH
            )  # what the kernel has not brought over yet
            far = os.open(self.target, os.O_RDWR | os.O_NOCTTY)
            try:
                tty.setraw(far, termios.TCSAFLUSH)
            finally:
                os.close(far)

    def close(self) -> None:
        """Hang up, and take the symlink away if it still points here."""
        os.close(self._near)
        with suppress(OSError):
            if self._link.readlink() == Path(self.target):
                self._link.unlink()

    def _point_link(self) -> None:
        if self._link.exists() and not self._link.is_symlink():
            raise FileExistsError(errno.EEXIST, "exists and is no symlink")
        self._link.parent.mkdir(parents=True, exist_ok=True)
        fresh = self._link.with_name(f".{self._link.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(self.target)
        fresh.replace(self._link)


class PtyWriter:
    """A pseudo terminal for whole messages, to write to without ever waiting."""

    def __init__(self, symlink: str) -> None:
        self._pty = Pty(symlink)
        self._rest = b""
        self._was_read = False

    @property
    def has_reader(self) -> bool:
        """Whether a program holds the far end open."""
        return self._pty.has_reader

    def write(self, message: bytes) -> bool:
        """Send a whole message, or drop it where the reader still has not taken the one before.

        Returns
        -------
        bool
            Whether it is on its way: a message once begun is ended with the next one. Where nobody
            reads it is gone, as in a line with nothing at its other end.
        """
        self._pty.ignore_input()
        if not self._pty.has_reader:
            if self._was_read:
                self._pty.forget_unread()
            self._was_read, self._rest = False, b""
            return True
        self._was_read = True
        self._push()
        if self._rest:
            return False
        self._rest = message
        self._push()
        return True

    def close(self) -> None:
        """Hang up."""
        self._pty.close()

    def _push(self) -> None:
        if self._rest:
            self._rest = self._rest[self._pty.put(self._rest) :]
