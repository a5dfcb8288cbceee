"""How far a long piece of work has come: a bar on standard error, where somebody looks at it."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Tell = Callable[[str, float], None]
"""Is told what is being done, and which share of it is (0 .. 1)."""

PATIENCE_S = 2.0
"""What is over sooner has no bar."""


def nobody(_what: str, _share: float) -> None:
    """Is told in vain."""


@contextmanager
def bars() -> Iterator[Tell]:
    """A bar for each thing that is done meanwhile; none where standard error is no terminal."""
    from rich.console import Console  # on use: most commands need none of it
    from rich.progress import (
        BarColumn,
        Progress,
        TaskID,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    if not console.is_terminal:
        yield nobody
        return
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    progress = Progress(*columns, TimeRemainingColumn(), console=console)
    shown: dict[str, TaskID] = {}
    soon = threading.Timer(PATIENCE_S, progress.start)

    def tell(what: str, share: float) -> None:
        if what not in shown:
            shown[what] = progress.add_task(what, total=1.0)
        progress.update(shown[what], completed=share)

    soon.start()
    try:
        yield tell
    finally:
        soon.cancel()
        soon.join()
        progress.stop()
