"""Publishing costs what Zenoh costs: by turns with a bare loop, 200 times a second.

``pytest -m slow -s tests/bench/test_live.py``
"""

import json
import subprocess
import sys

import pytest

from tests.shared_data import ROOT

pytestmark = [pytest.mark.live, pytest.mark.slow]

RATIO = 2.0
"""Of the 99th percentiles, at most."""


def test_a_solution_is_under_way_as_long_as_a_bare_sample() -> None:
    command = [sys.executable, "-m", "tests.bench.live", "--duration", "30", "--json"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    for row in found["ms"]:
        if row["what"] in ("bare Zenoh", "published as by the gateway"):
            print(row)
    assert found["missing"] == 0
    assert found["published_over_bare_p99"] <= RATIO
