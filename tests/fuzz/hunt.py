"""One codec under libFuzzer, which never comes back: `python -m tests.fuzz` starts this."""

import sys
from random import Random

import atheris

with atheris.instrument_imports(include=["drivers"]):
    from tests.drivers.streams import decoder
    from tests.fuzz.sealing import sealed
    from tests.fuzz.trial import HEAD, check


def main(codec: str, arguments: list[str]) -> None:
    """Hunt; the arguments are libFuzzer's."""
    with atheris.instrument_imports(include=["drivers"]):
        decoder(codec)

    def mutated(data: bytes, longest: int, seed: int) -> bytes:
        """As libFuzzer likes it; three times of four with check values that hold."""
        changed = atheris.Mutate(data, longest)
        if Random(seed).randrange(4):
            changed = changed[:HEAD] + sealed(codec, changed[HEAD:])
        return bytes(changed[:longest])

    atheris.Setup(
        [sys.argv[0], *arguments], lambda data: check(codec, data), custom_mutator=mutated
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
