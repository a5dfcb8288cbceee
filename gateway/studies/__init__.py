"""Monte Carlo studies: one module for each published table, on the emulator's truth."""

from collections.abc import Callable
from importlib import import_module

from gateway.studies.montecarlo import Workers
from gateway.studies.table import Study

STUDIES = {
    "relative-measurement": "gateway.studies.relative_measurement:run",
    "propagation-delay": "gateway.studies.propagation_delay:run",
    "radial-velocity": "gateway.studies.radial_velocity:run",
    "invariant-small": "gateway.studies.invariant:run_small",
    "invariant-large": "gateway.studies.invariant:run_large",
    "invariant-semi": "gateway.studies.invariant:run_semi",
}
"""Name of a study -> ``module:function``; the function takes the number of runs and the workers."""

RUNS = 50
"""Runs of a study unless told otherwise, as seed 004 makes them."""


def load(name: str) -> Callable[[int, Workers], Study]:
    """The function of a study, imported on use."""
    module, function = STUDIES[name].split(":")
    found: Callable[[int, Workers], Study] = getattr(import_module(module), function)
    return found
