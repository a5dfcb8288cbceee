"""The service manager's notification protocol (sd_notify): a few datagrams to ``$NOTIFY_SOCKET``.

Outside systemd there is no such socket and every call is an honest no-op. Source: sd_notify(3),
sd_watchdog_enabled(3).
"""

import os
import socket


def notify_ready() -> bool:
    """Say that start-up is over: solutions can flow."""
    return _notify("READY=1")


def notify_stopping() -> bool:
    """Say that the program is on its way down."""
    return _notify("STOPPING=1")


def notify_status(text: str) -> bool:
    """Give the one line that ``systemctl status`` shows."""
    return _notify("STATUS=" + " ".join(text.split()))


def notify_watchdog() -> bool:
    """Put off the watchdog; call it only while the program does its work."""
    return _notify("WATCHDOG=1")


def watchdog_interval_s() -> float | None:
    """Seconds between two `notify_watchdog` at most, half of what the manager would tolerate.

    None where no watchdog is set, or where it watches another process.
    """
    try:
        pid = int(os.environ.get("WATCHDOG_PID") or os.getpid())
        limit_us = int(os.environ["WATCHDOG_USEC"])
    except (KeyError, ValueError):
        return None
    return limit_us / 2e6 if pid == os.getpid() and limit_us > 0 else None


def _notify(message: str) -> bool:
    """Send one message; whether the manager got it. It must never disturb the program."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    if address.startswith("@"):  # a name in the abstract namespace
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            channel.setblocking(False)
            channel.sendto(message.encode(), address)
    except OSError:
        return False
    return True
