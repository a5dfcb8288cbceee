"""A minute of the soak, so that its command cannot rot."""

import subprocess
import sys

import pytest

from tests.shared_data import ROOT


@pytest.mark.slow
@pytest.mark.live
def test_a_minute_has_no_findings() -> None:
    """``pytest -m slow tests/soak``; the whole: ``python -m tests.soak --minutes 30``."""
    command = [sys.executable, "-m", "tests.soak", "--minutes", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("0 findings\n")
