"""What the demo shows: the solution, its error against the truth, and a summary at the end."""

import asyncio
import signal
import tempfile
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from gateway.demo.stage import PLOTTER_PORT, Stage, playing
from gateway.demo.viewer import SCORED_S, Sample, Viewer, rms
from gateway.errors import UsblnavError

LINE_S = 5.0
"""Period of the status lines where there is no terminal."""
SAID = 5
"""Messages of the processes that stay on the screen."""


def run(duration_s: float, filter_name: str) -> None:
    """Run the demo and print its summary line.

    Raises
    ------
    UsblnavError
        If a part of it fails, no solution was seen, or it is told to end early.
    """
    with tempfile.TemporaryDirectory(prefix="usblnav-demo-") as folder:
        try:
            asyncio.run(_run(Stage(Path(folder), filter_name), duration_s))
        except asyncio.CancelledError:
            raise UsblnavError("terminated") from None


async def _run(stage: Stage, duration_s: float) -> None:
    task = asyncio.current_task()
    assert task is not None
    # The processes of the demo have to be ended, or they would run for ever.
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    console = Console(highlight=False, soft_wrap=True)
    viewer = Viewer(stage)
    with ExitStack() as stack:
        show, say = _on_terminal(console, stage, viewer, stack)
        async with playing(stage, say):
            with viewer.listening():
                await viewer.first()
                ends = time.monotonic() + duration_s
                while (left := ends - time.monotonic()) > 0.0:
                    show()
                    await asyncio.sleep(min(0.25, left))
    console.print(_summary(viewer, duration_s))


def _on_terminal(
    console: Console, stage: Stage, viewer: Viewer, stack: ExitStack
) -> tuple[Callable[[], None], Callable[[str], None]]:
    """How to show the present and what the processes say: a live screen, or lines in a pipe."""
    if not console.is_terminal:
        lines = _Lines(console, viewer)
        return lines.show, console.print
    said: deque[str] = deque(maxlen=SAID)
    live = stack.enter_context(Live(console=console, refresh_per_second=4, transient=True))
    return lambda: live.update(screen(stage, viewer, said)), said.append


class _Lines:
    """A line every few seconds, for a pipe or a log."""

    def __init__(self, console: Console, viewer: Viewer) -> None:
        self._console = console
        self._viewer = viewer
        self._due = 0.0

    def show(self) -> None:
        """Print when it is time."""
        if self._viewer.samples and time.monotonic() >= self._due:
            self._due = time.monotonic() + LINE_S
            self._console.print(_line(self._viewer.samples[-1]))


def _line(sample: Sample) -> str:
    nav = sample.nav
    return (
        f"{nav.mode.value:14} {nav.lat_deg:.6f} {nav.lon_deg:.6f} {nav.height_m:+.1f} m  "
        f"heading {nav.heading_deg:5.1f}  sigma {nav.ellipse_major_m:.2f} m  "
        f"error {sample.horizontal_m:.2f} m  "
        f"fixes {nav.fixes_used} used {nav.fixes_rejected} refused"
    )


def screen(stage: Stage, viewer: Viewer, said: deque[str]) -> Group:
    """The live screen."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(justify="right", style="dim")
    grid.add_column()
    grid.add_row("in", "   ".join(stage.lines))
    grid.add_row(
        "out",
        f"NMEA on UDP {PLOTTER_PORT} and {stage.nmea_port}, Zenoh at {stage.endpoint}",
    )
    if viewer.samples:
        _rows(grid, viewer.samples[-1])
    grid.add_row("heard", f"{viewer.solutions} by Zenoh, {viewer.sentences} NMEA sentences")
    grid.add_row("", viewer.last_sentence)
    return Group(
        Text("usblnav demo", style="bold"), grid, *(Text(line, style="dim") for line in said)
    )


def _rows(grid: Table, sample: Sample) -> None:
    """The solution, its sigmas, and its error."""
    nav = sample.nav
    grid.add_row("mode", Text(nav.mode.value, style="bold green"))
    grid.add_row("position", f"{nav.lat_deg:.7f}  {nav.lon_deg:.7f}  {nav.height_m:+.2f} m")
    grid.add_row(
        "attitude",
        f"roll {nav.roll_deg:+.2f}  pitch {nav.pitch_deg:+.2f}  heading {nav.heading_deg:.2f} deg",
    )
    grid.add_row(
        "sigma",
        f"north {nav.sd_n_m:.2f}  east {nav.sd_e_m:.2f}  down {nav.sd_d_m:.2f} m"
        f"  heading {nav.sd_heading_deg:.3f} deg",
    )
    grid.add_row("fixes", f"{nav.fixes_used} used, {nav.fixes_rejected} refused")
    grid.add_row(
        "error",
        Text(
            f"{sample.horizontal_m:.2f} m horizontal, {sample.heading_deg:+.3f} deg heading",
            style="bold",
        ),
    )


def _summary(viewer: Viewer, duration_s: float) -> str:
    """The last line.

    Raises
    ------
    UsblnavError
        If nothing could be compared with the truth.
    """
    scored = viewer.scored()
    if not scored:
        raise UsblnavError("no solution could be compared with the truth")
    nav = scored[-1].nav
    return (
        f"demo: {duration_s:.0f} s, horizontal RMS error "
        f"{rms([s.horizontal_m for s in scored]):.2f} m and heading "
        f"{rms([s.heading_deg for s in scored]):.3f} deg over the last "
        f"{min(SCORED_S, duration_s):.0f} s; {nav.fixes_used} fixes used, "
        f"{nav.fixes_rejected} refused; heard {viewer.solutions} solutions by Zenoh and "
        f"{viewer.sentences} NMEA sentences"
    )
