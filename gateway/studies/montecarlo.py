"""Runs in parallel: processes of this machine, or a cluster through dask, with a progress bar."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any, TypeVar

import joblib
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from gateway.errors import UsblnavError

R = TypeVar("R")


@dataclass(frozen=True)
class Workers:
    """Who runs a study.

    Attributes
    ----------
    jobs
        Processes; -1 is one for each core.
    dask
        Address of a scheduler, which takes the place of the processes; None for this machine.
    """

    jobs: int = -1
    dask: str | None = None

    def map(self, run: Callable[..., R], shared: tuple[Any, ...], runs: int, title: str) -> list[R]:
        """Give ``[run(*shared, seed) for seed in range(runs)]``, with a progress bar."""
        calls = (joblib.delayed(run)(*shared, seed) for seed in range(runs))
        with self._backend(), _bar(title, runs) as step:
            results = []
            for result in joblib.Parallel(n_jobs=self.jobs, return_as="generator")(calls):
                results.append(result)
                step()
            return results

    def _backend(self) -> AbstractContextManager[Any]:
        return nullcontext() if self.dask is None else _cluster(self.dask)


@contextmanager
def _cluster(address: str) -> Iterator[None]:
    """A dask cluster as joblib's backend."""
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise UsblnavError("--dask: not installed; pip install 'usblnav[cluster]'") from error
    try:
        client: AbstractContextManager[Any] = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise UsblnavError(f"--dask: no scheduler at {address}") from error
    with client, joblib.parallel_config(backend="dask"):
        yield


@contextmanager
def _bar(title: str, total: int) -> Iterator[Callable[[], None]]:
    """A progress bar on standard error, where somebody looks at it."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(
        *columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(title, total=total)
        yield lambda: progress.advance(task)
