"""OpenCPN, the real one, on a screen of its own: ship and target stand where truth has them.

``scripts/chart`` takes the picture (and says how to get OpenCPN); a minute and a half for each.
``OPENCPN_ROOT=/srv/trixie pytest -m slow tests/integration/test_opencpn.py``
"""

import os
import shutil
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import yaml
from matplotlib.image import imread
from numpy.typing import NDArray
from scipy import ndimage

from gateway.emulator import twin
from gateway.emulator.trajectory import Trajectory
from gateway.nav.earth import radii
from tests.shared_data import ROOT

FOLDER = os.environ.get("OPENCPN_ROOT")
pytestmark = [
    pytest.mark.live,
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(
        not FOLDER and not shutil.which("opencpn"), reason="no OpenCPN (scripts/chart)"
    ),
]

CHART = (slice(60, 460), slice(90, 540))
"""Rows and columns of the picture that are chart alone."""
SHIP_M = 3.0
"""The ship's hull on the picture is 25 m long; its middle was within 1.6 m."""
TARGET_M = 5.0
"""An array of 1 degree, and a place that may be a second old; 2.2 m were seen."""


@pytest.fixture(scope="module")
def chart() -> ModuleType:
    """The script as a module."""
    loader = SourceFileLoader("chart", str(ROOT / "scripts" / "chart"))
    spec = spec_from_loader("chart", loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def truth_m(chart: ModuleType, folder: Path) -> dict[str, NDArray[np.float64]]:
    """East and north of the beacon, of ship and target, at the marked moment (m, shape (2,))."""
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(chart.scenario(1_800_000_000.0, follows=True)))
    loaded = twin.load(file)
    ways = {"ship": loaded.trajectory} | {b.name: b.trajectory for b in loaded.mobile.values()}
    lat, lon = np.deg2rad(chart.HERE)
    meridian, prime_vertical = radii(lat)
    found = {}
    for name, way in ways.items():
        path = Trajectory(way, loaded.duration_s).geodetic(np.array([chart.MARKED_S]))
        east = (path.lon[0] - lon) * prime_vertical * np.cos(lat)
        found[name] = np.array([east, (path.lat[0] - lat) * meridian])
    return found


def middle(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Column and row of the middle of the greatest patch (pixels, shape (2,))."""
    patches, count = ndimage.label(mask, np.ones((3, 3)))
    assert count
    greatest = 1 + np.argmax(ndimage.sum(mask, patches, range(1, count + 1)))
    row, column = ndimage.center_of_mass(patches == greatest)
    return np.array([column, row])


def seen_m(picture: Path, radius_m: float) -> dict[str, NDArray[np.float64]]:
    """East and north of the beacon's mark on the picture, measured by the circle of the truth."""
    red, green, blue = np.moveaxis(imread(picture)[CHART][..., :3], 2, 0)
    beacon = middle((blue > 0.7) & (red < 0.25) & (green < 0.25))
    rows, columns = np.nonzero((red > 0.88) & (green > 0.78) & (blue < 0.35))
    away = np.hypot(columns - beacon[0], rows - beacon[1])
    scale = np.median(away[(away > 120.0) & (away < 150.0)]) / radius_m
    ship = middle((red > 0.43) & (green < 0.35) & (blue < 0.35))
    found = {"ship": (ship - beacon) / scale * (1, -1)}
    target = (green > 0.7) & (red < 0.55) & (blue < 0.55)
    return found | ({"rov": (middle(target) - beacon) / scale * (1, -1)} if target.any() else {})


@pytest.mark.parametrize(("by", "follows"), [("udp", True), ("tcp", False), ("pty", False)])
def test_the_ship_is_drawn_where_truth_has_it(
    chart: ModuleType, by: str, follows: bool, tmp_path: Path
) -> None:
    if by == "pty" and FOLDER and not os.path.ismount(f"{FOLDER}/dev/pts"):
        pytest.skip(f"mount --bind /dev/pts {FOLDER}/dev/pts")
    picture = tmp_path / "chart.png"
    options = [*(["--root", FOLDER] if FOLDER else []), *(["--follows"] if follows else [])]
    command = [sys.executable, "scripts/chart", str(picture), "--by", by, *options]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    true = truth_m(chart, tmp_path)
    seen = seen_m(picture, float(np.hypot(*true["ship"])))
    away_m = {name: float(np.hypot(*(place - true[name]))) for name, place in seen.items()}
    print(f"{by}: " + ", ".join(f"{name} {away:.1f} m off" for name, away in away_m.items()))
    assert away_m.keys() == ({"ship", "rov"} if follows else {"ship"})
    assert away_m["ship"] < SHIP_M
    assert away_m.get("rov", 0.0) < TARGET_M
