"""Outputs: what of a block goes with what, and what it needs of other blocks."""

from collections.abc import Iterator

from gateway.config.blocks import Config
from gateway.config.drafts import readable_outputs
from gateway.config.nmea import DEPTH_SENTENCES, OWN_SENTENCES, NmeaOutput
from gateway.config.zenoh import ZenohOutput
from gateway.schema import known, suggest


def output_faults(config: Config) -> Iterator[str]:
    """What no output could do."""
    yield from _zenoh(config)
    yield from _depths(config)
    yield from _outputs_of_targets(config)


def _zenoh(config: Config) -> Iterator[str]:
    for path, output in readable_outputs(config):
        if isinstance(output, ZenohOutput):
            yield from _zenoh_output(output, path)


def _zenoh_output(output: ZenohOutput, path: str) -> Iterator[str]:
    """What of a Zenoh output goes with what."""
    if output.mode == "client" and not output.connect:
        yield f"{path}.connect: missing; a client needs its router's endpoint"
    if (output.user is None) != (output.password_file is None):
        missing = "user" if output.user is None else "password_file"
        yield f"{path}.{missing}: missing; user and password_file belong together"
    if output.users_file is not None and output.mode == "client":
        yield f"{path}.users_file: a client lets nobody in"
    tls = output.tls
    if tls is None or not known(tls):
        return
    if (tls.certificate is None) != (tls.private_key is None):
        missing = "certificate" if tls.certificate is None else "private_key"
        yield f"{path}.tls.{missing}: missing; certificate and private_key belong together"
    elif tls.mutual and (tls.certificate is None or tls.root_ca is None):
        missing = "certificate" if tls.certificate is None else "root_ca"
        yield f"{path}.tls.{missing}: missing; mutual needs root_ca, certificate and private_key"
    elif tls.certificate is None and known(output.listen) and any(map(_is_tls, output.listen)):
        yield f"{path}.tls.certificate: missing; who listens on tls must show one"


def _is_tls(endpoint: str) -> bool:
    return known(endpoint) and endpoint.startswith(("tls/", "quic/"))


def _depths(config: Config) -> Iterator[str]:
    """A depth to be sent needs to know where the surface is."""
    for path, output in readable_outputs(config):
        if not isinstance(output, NmeaOutput) or not known(output.sentences):
            continue
        asked = [name for name in output.sentences if name in DEPTH_SENTENCES]
        if asked and output.surface_height_m is None:
            yield (
                f"{path}.surface_height_m: missing; {asked[0]} needs the height of the"
                " water's surface above the ellipsoid"
            )


def _outputs_of_targets(config: Config) -> Iterator[str]:
    """What is to speak of a target needs one, and sentences that a target has."""
    if not known(config.beacons):
        return
    names = [target.name for target in config.targets.values()]
    for path, output in readable_outputs(config):
        if not isinstance(output, NmeaOutput) or not known(output.target, output.sentences):
            continue
        if output.target is not None and output.target not in names:
            unknown = f"no target is called {output.target}; {suggest(output.target, names)}"
            yield f"{path}.target: {unknown}"
        unfit = [name for name in output.sentences if name in OWN_SENTENCES]
        if output.target is not None and unfit:
            yield f"{path}.sentences: {', '.join(unfit)} cannot be said of a target"
