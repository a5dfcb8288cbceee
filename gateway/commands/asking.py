"""Which running gateway a command means: by its configuration, or by where it is to be found."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import msgspec

from gateway.config import ZenohOutput, load
from gateway.errors import ConfigError
from gateway.outputs.zenoh import DEFAULT_ENDPOINT, at, client_of


def whom(arguments: Namespace) -> tuple[ZenohOutput, str]:
    """A client's settings and the vehicle's name, ``*`` for any.

    Raises
    ------
    ConfigError
        If the configuration cannot be used or has no Zenoh output.
    """
    place, vehicle = at(DEFAULT_ENDPOINT), "*"
    if arguments.config is not None:
        config = load(arguments.config)
        place, vehicle = _place(config.outputs, arguments.config), config.vehicle
    if arguments.connect:
        place = msgspec.structs.replace(place, connect=(arguments.connect,))
    return place, vehicle


def _place(outputs: Sequence[object], file: Path) -> ZenohOutput:
    """How a client finds the gateway of a configuration."""
    for output in outputs:
        if isinstance(output, ZenohOutput):
            return client_of(output)
    raise ConfigError(["outputs: none is of type zenoh, which is what is asked"], file)
