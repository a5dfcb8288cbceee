"""The site of each test: memory, ptys, UDP and TCP in turn, or the real ports of ``--rig``."""

from collections.abc import AsyncIterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.integration.rig import brisk
from tests.rig.sites import Live, Memory, Site
from tests.rig.wiring import cables, ports

KINDS = (
    "memory",
    *(
        pytest.param(kind, marks=[pytest.mark.live, pytest.mark.slow])
        for kind in ("pty", "udp", "tcp")
    ),
)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One run of each test for each kind of cable."""
    if "site" not in metafunc.fixturenames:
        return
    text = metafunc.config.getoption("--rig")
    if text is None:
        metafunc.parametrize("site", KINDS, indirect=True)
        return
    try:
        chosen = ports(text)
    except ValueError as error:
        raise pytest.UsageError(str(error)) from error
    wired = pytest.param(chosen, marks=pytest.mark.live, id=text)
    metafunc.parametrize("site", [wired], indirect=True)


@pytest.fixture
def story() -> dict[str, Any]:
    """What a test changes of the scenario."""
    return {}


@pytest.fixture
async def site(
    request: pytest.FixtureRequest, tmp_path: Path, story: dict[str, Any]
) -> AsyncIterator[Site]:
    """The cables lie and are plugged in; nothing has power."""
    scenario = brisk(tmp_path) | story
    if request.param == "memory":
        yield Memory(scenario)
        return
    with ExitStack() as stack:
        yield Live(tmp_path, scenario, cables(request.param, tmp_path, stack))
