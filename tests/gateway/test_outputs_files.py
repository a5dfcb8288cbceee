"""The files of a replay: their columns, their bytes, and a disk that is full."""

import csv
import json
from pathlib import Path

import pytest

from gateway.errors import UsblnavError
from gateway.messages import Calibration, Component, Constant, Innovation
from gateway.outputs.files import ReplayFiles, seconds
from gateway.outputs.schema import calibration_report, innovation_report, nav_report
from tests.gateway.test_outputs_schema import OFFSET_NS, solution

NAV = nav_report(solution(), OFFSET_NS)
USED = Innovation(
    0, "usbl0", "1", (Component("bearing_deg", -1.25, 0.5), Component("range_m", 2, 3)), 9, True, ""
)
REFUSED = Innovation(0, "usbl0", 'odd, "name"', (), float("nan"), False, "late")
CONSTANTS = Calibration(0, (Constant("range_scale", 0.004, 1e-4),))


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def fill(folder: Path) -> None:
    with ReplayFiles(folder) as out:
        out.nav(NAV)
        out.innovation(innovation_report(USED, OFFSET_NS))
        out.innovation(innovation_report(REFUSED, OFFSET_NS))
        out.calibration(calibration_report(CONSTANTS, OFFSET_NS))
        out.summary({"devices": {"imu0": {"records": 3}}})


def test_nav_has_the_columns_that_interfaces_promise(tmp_path: Path) -> None:
    fill(tmp_path)
    header, row = (tmp_path / "nav.csv").read_text().splitlines()
    assert header == (
        "t_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,roll_deg,pitch_deg,heading_deg,"
        "sd_n_m,sd_e_m,sd_d_m,sd_vn_m_s,sd_ve_m_s,sd_vd_m_s,sd_roll_deg,sd_pitch_deg,"
        "sd_heading_deg,mode"
    )
    assert row == (
        "1700000005.123457,39.8000000000,116.2000000000,-50.2500,3.00000,-0.50000,0.25000,"
        "-1.500000,2.500000,350.000000,0.3000,0.4000,0.5000,0.01000,0.02000,0.03000,"
        "0.100000,0.200000,0.300000,aided"
    )


def test_innovations_have_a_row_a_component_and_lose_no_refused_fix(tmp_path: Path) -> None:
    fill(tmp_path)
    bearing, distance, refused = read(tmp_path / "innovations.csv")
    assert bearing == {
        "t_s": "1700000000.123457",
        "device": "usbl0",
        "beacon": "1",
        "component": "bearing_deg",
        "value": "-1.250000",
        "sigma": "0.500000",
        "nis": "9.000000",
        "accepted": "1",
        "reason": "",
    }
    assert (distance["component"], distance["value"]) == ("range_m", "2.000000")
    assert (refused["beacon"], refused["component"], refused["nis"]) == ('odd, "name"', "", "")
    assert (refused["accepted"], refused["reason"]) == ("0", "late")


def test_calibration_and_summary(tmp_path: Path) -> None:
    fill(tmp_path)
    assert (tmp_path / "calibration.csv").read_text() == (
        "t_s,name,value,sigma\n1700000000.123457,range_scale,0.004000000,0.000100000\n"
    )
    assert json.loads((tmp_path / "summary.json").read_text()) == {
        "devices": {"imu0": {"records": 3}}
    }


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    fill(tmp_path / "a")
    fill(tmp_path / "b")
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


@pytest.mark.parametrize(
    ("utc_ns", "text"),
    [
        (0, "0.000000"),
        (1_700_000_000_000_000_499, "1700000000.000000"),
        (1_700_000_000_000_000_500, "1700000000.000001"),
        (1_799_999_999_999_999_500, "1800000000.000000"),
        (9_007_199_254_740_993_000, "9007199254.740993"),
    ],
)
def test_time_is_written_without_a_float(utc_ns: int, text: str) -> None:
    assert seconds(utc_ns) == text


@pytest.mark.parametrize("name", ["nav.csv", "innovations.csv", "calibration.csv"])
def test_a_full_disk_is_one_clear_line(tmp_path: Path, name: str) -> None:
    (tmp_path / name).symlink_to("/dev/full")
    with pytest.raises(UsblnavError) as caught:
        fill(tmp_path)
    assert str(caught.value) == f"{tmp_path / name}: cannot write: No space left on device"


def test_a_disk_that_fills_on_the_way_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "nav.csv").symlink_to("/dev/full")
    with pytest.raises(UsblnavError, match="No space left"), ReplayFiles(tmp_path) as out:
        for _ in range(10_000):
            out.nav(NAV)


def test_a_full_disk_for_the_summary(tmp_path: Path) -> None:
    (tmp_path / "summary.json").symlink_to("/dev/full")
    with pytest.raises(UsblnavError, match=r"summary\.json: cannot write: No space"):
        fill(tmp_path)


def test_a_folder_that_is_a_file_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(UsblnavError, match="out: cannot write: File exists"):
        fill(tmp_path / "out")
