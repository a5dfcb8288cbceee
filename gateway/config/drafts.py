"""What can be read of a draft, in which a hole stands where a fault has been named already."""

from collections.abc import Iterator

from gateway.config.blocks import Config, Output
from gateway.config.devices import Device
from gateway.schema import known


def readable_devices(config: Config) -> dict[str, Device]:
    """The devices by name, without those that are holes."""
    devices = config.devices if known(config.devices) else {}
    return {name: device for name, device in devices.items() if known(device)}


def readable_outputs(config: Config) -> Iterator[tuple[str, Output]]:
    """Each output with its path, without those that are holes."""
    for n, output in enumerate(config.outputs if known(config.outputs) else ()):
        if known(output):
            yield f"outputs[{n}]", output
