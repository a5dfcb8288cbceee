"""Golden frames of the shared vectors, and what stands stated beside them."""

import json
from typing import Any

from tests.shared_data import shared


def frames(name: str) -> list[bytes]:
    """The frames of a file, one a line."""
    lines = shared("vectors", "imu", f"{name}.hex").read_text().split()
    return [bytes.fromhex(line) for line in lines]


def stated(name: str) -> dict[str, Any]:
    """Where they are from, and their decoded values."""
    said: dict[str, Any] = json.loads(shared("vectors", "imu", f"{name}.json").read_text())
    return said
