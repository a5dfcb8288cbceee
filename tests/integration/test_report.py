"""The page of a replay and of a recording: what it holds, and that it asks nothing of the world."""

import csv
import json
import re
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import yaml

from gateway import cli, replay, report
from gateway.config import load
from gateway.emulator import twin
from gateway.emulator.player import emulate
from gateway.report import figures
from tests.gateway.emulated import demo_data, make
from tests.integration.rig import USBLNAV
from tests.shared_data import ROOT

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FIGURES = {"track", "errors", "sigmas", "motion", "innovations", "nis", "calibration"}
NAMESPACES = ("http://www.w3.org/", "http://purl.org/", "http://creativecommons.org/")


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with OUT of a replay, and the truth."""
    folder = tmp_path_factory.mktemp("voyage")
    data = demo_data() | {"duration_s": 60.0}
    data["devices"]["imu0"]["rate_hz"] = 50
    scenario = twin.for_capture(make(data))
    emulate(scenario, pcap=folder / "sea.pcap", truth=folder / "truth.csv", say=lambda _line: None)
    config = folder / "config.yaml"
    config.write_text(yaml.safe_dump(twin.gateway_config(scenario)))
    replay.run([folder / "sea.pcap"], load(config), out=folder / "OUT", rate_hz=5.0)
    return folder


@pytest.fixture(scope="module")
def plain(voyage: Path) -> str:
    """Its page."""
    return report.text(report.read(voyage / "OUT"))


@pytest.fixture(scope="module")
def fuller(voyage: Path) -> tuple[report.Source, str]:
    """The same voyage with a target that was followed, and an attitude that was sought."""
    out = voyage / "FULLER"
    shutil.copytree(voyage / "OUT", out)
    with (out / "targets.csv").open("w") as file:
        table = csv.writer(file)
        table.writerow(["t_s", "name", "state", "lat_deg", "lon_deg"])
        table.writerows([k, "rov", "tracked", 39.8 + k * 1e-5, 116.2] for k in range(5))
        table.writerow([5, "rov", "lost", 45.0, 116.2])
    with (out / "innovations.csv").open("a") as file:
        table = csv.writer(file)
        table.writerow([1_700_000_000, "imu0", "", "", "", "", "", 0, "level_turning"])
        for name, value in (("roll", -0.001), ("pitch", 1.34), ("heading", 24.79)):
            row = [1_700_000_030, "imu0", "", f"{name}_deg", value, 0.04, "", 1, ""]
            table.writerow(row)
    source = report.read(out)
    return source, report.text(source)


class Page(HTMLParser):
    """What a browser would make of it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.figures: list[str] = []
        self.asked: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        given = dict(attrs)
        if tag == "figure":
            self.figures.append(given["id"] or "")
        self.asked += [given[name] or "" for name in ("src", "href", "xlink:href") if name in given]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_page_of_a_replay_says_what_its_files_say(voyage: Path) -> None:
    command = [*USBLNAV, "report", voyage / "OUT", "--truth", voyage / "truth.csv"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"report in {voyage / 'OUT' / 'report.html'}\n"
    text = (voyage / "OUT" / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert set(page.figures) == FIGURES
    assert page.tags["svg"] == len(FIGURES)
    summary = json.loads((voyage / "OUT" / "summary.json").read_text())
    assert f"{summary['filter']['fixes_used']}fixes used" in page.text
    with (voyage / "OUT" / "nav.csv").open() as file:
        nav = list(csv.DictReader(file))
    aided = 100.0 * np.mean([row["mode"] == "aided" for row in nav])
    assert f"{aided:.1f} %aided" in page.text
    assert f"{horizontal_rms_m(nav, voyage / 'truth.csv'):.2f} mhorizontal RMS" in page.text
    # Nothing is asked of any other place.
    assert not page.tags["script"]
    assert not [place for place in page.asked if not place.startswith(("#", "data:"))]
    assert "url(http" not in text
    assert all(text[at:].startswith(NAMESPACES) for at in places(text, "http"))


def horizontal_rms_m(nav: list[dict[str, str]], truth: Path) -> float:
    """On a sphere: to a part in three hundred, the place being the same."""
    true = np.genfromtxt(truth, delimiter=",", names=True)
    t_s, lat, lon = (np.array([float(r[k]) for r in nav]) for k in ("t_s", "lat_deg", "lon_deg"))
    inside = (t_s >= true["t_s"][0]) & (t_s <= true["t_s"][-1])
    north = (lat - np.interp(t_s, true["t_s"], true["lat_deg"])) * 111_180.0
    east = (
        (lon - np.interp(t_s, true["t_s"], true["lon_deg"])) * 111_180.0 * np.cos(np.radians(lat))
    )
    return float(np.sqrt(np.mean(north[inside] ** 2 + east[inside] ** 2)))


def places(text: str, what: str) -> list[int]:
    return [at for at in range(len(text)) if text.startswith(what, at)]


def test_the_same_replay_gives_the_same_page(voyage: Path, plain: str) -> None:
    assert report.text(report.read(voyage / "OUT")) == plain
    assert "errors" not in Page(plain).figures


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_complains_of_nothing_and_asks_for_nothing(plain: str, tmp_path: Path) -> None:
    log = tmp_path / "net.json"
    (tmp_path / "page.html").write_text(plain, encoding="utf-8")
    serve = partial(SimpleHTTPRequestHandler, directory=tmp_path)
    with ThreadingHTTPServer(("127.0.0.1", 0), serve) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/page.html"
        done = browse(url, log, tmp_path / "profile")
        server.shutdown()
    assert Page(done.stdout).tags["svg"] == len(FIGURES) - 1
    assert "CONSOLE" not in done.stderr
    asked = set(re.findall(r'"url":"(\w+://[^"]*)"', log.read_text(errors="replace")))
    assert url in asked
    asked -= {url, url.removesuffix("page.html")}  # the place itself stands in the log too
    # The browser looks round by itself, at its maker's.
    assert not [other for other in asked if not re.search(r"google|gvt1\.com", other)]


def browse(url: str, log: Path, profile: Path) -> "subprocess.CompletedProcess[str]":
    """What a browser makes of a page, what it says to that, and a log of all that it asks for."""
    return subprocess.run(
        [
            *(str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu"),
            *("--disable-background-networking", "--disable-component-update"),
            *("--enable-logging=stderr", f"--log-net-log={log}", f"--user-data-dir={profile}"),
            *("--virtual-time-budget=3000", "--dump-dom", url),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=90,
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere: no such file or folder"),
        (["{empty}"], "{empty}: no nav.csv, innovations.csv, calibration.csv, summary.json;"),
        (
            ["{out}", "--truth", "{out}/nav.json"],
            "{out}/nav.json: no such file or directory",
        ),
        (["{out}", "--truth", "{out}/summary.json"], "{out}/summary.json: not a truth file"),
        (["{out}", "-o", "{out}/no/such.html"], "{out}/no/such.html: cannot write: No such file"),
    ],
)
def test_what_cannot_be_shown_is_named(
    voyage: Path,
    tmp_path: Path,
    arguments: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    named = {"out": voyage / "OUT", "empty": tmp_path}
    assert cli.main(["report", *(argument.format(**named) for argument in arguments)]) in (1, 2)
    assert said.format(**named) in capsys.readouterr().err


def test_what_was_followed_is_in_the_track(fuller: tuple[report.Source, str], plain: str) -> None:
    source, page = fuller
    assert np.isfinite(source.targets["rov"]).all(axis=1).tolist() == [True] * 5 + [False]
    assert "target rov" in page
    assert "target rov" not in plain


def test_what_the_imu_found_stands_in_a_table(fuller: tuple[report.Source, str]) -> None:
    source, page = fuller
    assert {device for device, _ in source.innovations} == {"usbl0"}
    said = Page(page).text
    assert "22:13:20---level_turning" in said
    assert "22:13:500.00 ± 0.04 deg1.34 ± 0.04 deg24.79 ± 0.04 degused" in said


def test_times_are_of_the_clock_and_metres_of_a_stated_place(voyage: Path, plain: str) -> None:
    page = Page(plain)
    with (voyage / "OUT" / "nav.csv").open() as file:
        nav = list(csv.DictReader(file))
    day = datetime.fromtimestamp(float(nav[0]["t_s"]), UTC)
    assert page.text.count(f"UTC, {day:%Y-%m-%d}") == 4  # sigmas, motion, innovations, NIS
    lat, lon = (np.mean([float(row[k]) for row in nav]) for k in ("lat_deg", "lon_deg"))
    assert f"in metres from {lat:.6f}° N, {lon:.6f}° E" in page.text


@pytest.mark.parametrize("seconds", [1, 7, 40, 100, 240, 1000, 4000, 40_000, 200_000])
def test_a_run_of_any_length_has_its_hours(voyage: Path, seconds: int) -> None:
    source = report.read(voyage / "OUT")
    begin = 1_795_390_000.0
    t_s = begin + np.linspace(0.0, seconds, len(source.nav["t_s"]))
    nav = replace(source.nav, columns=source.nav.columns | {"t_s": t_s})
    figure = figures.motion(replace(source, nav=nav))
    axis = figure.axes[-1]
    figure.canvas.draw()
    labels = [label.get_text() for label in axis.get_xticklabels()]
    assert 2 <= len(labels) <= 12
    hours = re.compile(r"\d\d:\d\d(:\d\d)?|[A-Z][a-z]{2} \d\d")
    assert [text for text in labels if not hours.fullmatch(text)] == []
