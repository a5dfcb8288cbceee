"""How many frames of each wire format one core decodes in a second."""

from statistics import median
from time import process_time

from drivers import registry
from tests.bench.replayed import Row
from tests.drivers.streams import FRAMES, decoder

CHUNK = 4096
FRAMES_EACH = 5000
RUNS = 5


def measure() -> list[Row]:
    """One row a codec and kind of frame, from its own `encode`, in chunks of a fast line."""
    kinds = [
        (name, kind, [frame for frame in FRAMES[name] if frame.isascii() == (kind == "text")])
        for name in registry.CODECS
        for kind in ("binary", "text")
    ]
    return [
        (f"{name} decoded, {kind}", median(_rate(name, frames) for _ in range(RUNS)), "frames/s")
        for name, kind, frames in kinds
        if frames
    ]


def _rate(name: str, frames: list[bytes]) -> float:
    """Frames a second through a fresh decoder."""
    stream = b"".join(frames * (FRAMES_EACH // len(frames)))
    chunks = [stream[at : at + CHUNK] for at in range(0, len(stream), CHUNK)]
    reader = decoder(name)
    begun = process_time()
    for chunk in chunks:
        for _ in reader.feed(chunk, 0):
            pass
    return FRAMES_EACH // len(frames) * len(frames) / (process_time() - begun)
