"""Where the golden frames and captures are: beside the project, never inside it."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SHARED = Path(os.environ.get("USBLNAV_SHARED", ROOT.parent / "shared"))


def shared(*parts: str) -> Path:
    """Path of a shared golden file; skips the test in a checkout that has none."""
    import pytest  # the fuzzer wants the paths alone, and has no pytest

    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"golden data not here: {'/'.join(parts)} (set USBLNAV_SHARED)")
    return path
