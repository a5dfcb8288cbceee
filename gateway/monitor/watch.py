"""Hears gateways over Zenoh and shows one of them until told to stop."""

import threading
import time
from contextlib import closing

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from gateway.config import ZenohOutput
from gateway.errors import UsblnavError
from gateway.monitor.heard import SILENT_S, Heard
from gateway.monitor.screen import SMALLEST, screen
from gateway.outputs.background import NAME as BACKGROUND
from gateway.outputs.zenoh import open_subscription

REFRESH_S = 0.25
AGAIN_S = 2.0
"""Between attempts to reach a gateway, and between looks at whether it is still heard."""
PATIENCE_S = 1.0
"""How long the end waits for Zenoh."""
FIRST_S = 5.0
"""How long to wait for a first status where there is no terminal."""


class Listener:
    """What is heard of all vehicles under a key, in a thread that never gives up.

    Attributes
    ----------
    heard
        By vehicle, in the order in which they were first heard.
    trouble
        Why nothing can be heard; empty while connected.
    """

    def __init__(self, place: ZenohOutput, vehicle: str) -> None:
        self.heard: dict[str, Heard] = {}
        self.trouble = ""
        self._place = place
        self._key = f"usblnav/{vehicle}/*/**"
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._listen, name=BACKGROUND, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take leave, so that the gateway does not wait for a reader that is gone."""
        self._ends.set()
        self._thread.join(PATIENCE_S)

    def _listen(self) -> None:
        """Hear; where all have fallen silent the session is opened anew."""
        while not self._ends.is_set():
            try:
                with open_subscription(self._place, self._key, self._take):
                    self.trouble = ""
                    begun = time.monotonic()
                    while time.monotonic() - begun < AGAIN_S or self._is_heard():
                        if self._ends.wait(AGAIN_S):
                            return
            except UsblnavError as error:
                self.trouble = str(error)
                self._ends.wait(AGAIN_S)

    def _is_heard(self) -> bool:
        return any(heard.silent_s < SILENT_S + AGAIN_S for heard in tuple(self.heard.values()))

    def _take(self, key: str, payload: bytes) -> None:
        _, vehicle, topic = key.split("/", 2)
        self.heard.setdefault(vehicle, Heard(vehicle)).take(topic, payload)


def watch(place: ZenohOutput, vehicle: str, once: bool) -> None:
    """Show a vehicle until interrupted, or its present state once.

    Raises
    ------
    UsblnavError
        If it is to be shown once and is not heard.
    """
    console = Console(highlight=False)
    with closing(Listener(place, vehicle)) as listener:
        if once or not console.is_terminal:
            console.print(_once(listener, console))
            return
        with Live(console=console, screen=True, auto_refresh=False) as live:
            while True:
                live.update(_present(listener, *console.size), refresh=True)
                time.sleep(REFRESH_S)


def _once(listener: Listener, console: Console) -> RenderableType:
    """The first screen that has a status and a solution, or what there is of it after a while."""
    end = time.monotonic() + FIRST_S
    while time.monotonic() < end:
        shown = next(iter(listener.heard.values()), None)
        if shown is not None and shown.status is not None and shown.nav is not None:
            break
        time.sleep(REFRESH_S)
    if listener.heard:
        time.sleep(2.2)  # two reports make a rate
        return _present(listener, max(console.width, SMALLEST[0]), SMALLEST[1])
    raise UsblnavError(listener.trouble or "no gateway is heard")


def _present(listener: Listener, width: int, height: int) -> RenderableType:
    """The vehicle that was heard first, or why there is none."""
    names = list(listener.heard)
    if not names:
        return Text(listener.trouble or "connected; no gateway is heard yet")
    return screen(listener.heard[names[0]], width, height, names[1:])
