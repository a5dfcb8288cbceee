"""Runs in parallel: processes of this machine, or a cluster through dask, with a progress bar."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import joblib

from gateway import progress
from gateway.errors import UsblnavError

if TYPE_CHECKING:
    from dask.distributed import Client

R = TypeVar("R")

_PATIENCE_S = 10.0
"""How long a scheduler may take to answer, and its workers to come."""


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
        with self._backend(shared), progress.bars() as tell, warnings.catch_warnings():
            # A process that has grown is replaced, which loses nothing.
            warnings.filterwarnings("ignore", "A worker stopped while some jobs")
            results = []
            tell(title, 0.0)
            for result in joblib.Parallel(n_jobs=self.jobs, return_as="generator")(calls):
                results.append(result)
                tell(title, len(results) / runs)
            return results

    def _backend(self, shared: tuple[Any, ...]) -> AbstractContextManager[Any]:
        return nullcontext() if self.dask is None else _cluster(self.dask, shared)


@contextmanager
def _cluster(address: str, shared: tuple[Any, ...]) -> Iterator[None]:
    """A dask cluster as joblib's backend; every worker is sent once what the runs share."""
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise UsblnavError("--dask: not installed; pip install 'usblnav[cluster]'") from error
    try:
        client = Client(address, timeout=_PATIENCE_S)
    except (OSError, ValueError) as error:
        raise UsblnavError(f"--dask: no scheduler at {address}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE_S)
        except TimeoutError as error:
            raise UsblnavError(f"--dask: the scheduler at {address} has no workers") from error
        _ask_for_us(client)
        with joblib.parallel_config(backend="dask", scatter=list(shared)):
            yield


def _ask_for_us(client: "Client") -> None:
    """Have every worker import what the runs need, before it is sent any."""

    def importing() -> None:  # within: it is sent as it is, not as a name to import
        import_module("gateway.studies.passage")

    for worker, fault in client.run(importing, on_error="return").items():
        if fault is not None:
            raise UsblnavError(f"--dask: worker {worker} cannot import usblnav: {fault}") from fault
