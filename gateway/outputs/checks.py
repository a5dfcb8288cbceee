"""Faults of outputs that only those who carry them can tell."""

from collections.abc import Iterator

from gateway.config import Config, ZenohOutput


def output_faults(config: Config) -> Iterator[str]:
    """What an output's carrier would not take, by its path in the file; opens nothing."""
    for path, output in _zenoh_outputs(config):
        if output.config:
            from gateway.outputs.zenoh.settings import faults  # zenoh only where it is asked for

            yield from faults(output, path)


def missing_files(config: Config) -> Iterator[str]:
    """Files that outputs need and that cannot be read here; a gateway that runs waits for them."""
    for path, output in _zenoh_outputs(config):
        if output.tls or output.password_file or output.users_file:
            from gateway.outputs.zenoh.settings import missing_files

            yield from missing_files(output, path)


def _zenoh_outputs(config: Config) -> Iterator[tuple[str, ZenohOutput]]:
    for n, output in enumerate(config.outputs):
        if isinstance(output, ZenohOutput):
            yield f"outputs[{n}]", output
