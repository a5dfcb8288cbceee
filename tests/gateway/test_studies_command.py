"""The command `usblnav study` as a user meets it, and a real cluster under it."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from gateway.errors import UsblnavError
from gateway.studies import STUDIES, invariant
from gateway.studies.montecarlo import Workers
from tests.gateway.command_line import usblnav
from tests.gateway.test_studies import short, voyage
from tests.shared_data import ROOT

DASK = [sys.executable, "-m", "dask"]


def test_a_study_prints_its_table_as_json_and_draws_it(tmp_path: Path) -> None:
    name = "relative-measurement"
    done = usblnav("study", name, "--runs", "1", "--jobs", "1", "--json", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr.decode()
    table = json.loads(done.stdout)
    assert (table["study"], table["runs"]) == (name, 1)
    assert table["seconds"] > 0.0
    rows = {row["id"]: row for row in table["rows"]}
    assert rows.keys() >= {
        "inertial_horizontal_rms_m",
        "usbl_horizontal_rms_m",
        "tight_horizontal_rms_white_m",
        "tight_horizontal_rms_both_m",
        "loose_horizontal_rms_both_m",
        "bound_ratio",
        "nees",
        "nis",
    }
    for row in rows.values():
        assert row.keys() == {"id", "published", "attained", "low", "high", "unit"}
    assert rows["usbl_horizontal_rms_m"]["published"] == 3.44
    assert json.loads((tmp_path / "out" / f"{name}.json").read_text()) == table
    picture = matplotlib.image.imread(tmp_path / "out" / f"{name}-horizontal.png")
    assert np.unique(picture.reshape(-1, picture.shape[-1]), axis=0).shape[0] > 10


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["figure-8"], "invalid choice: 'figure-8'"),
        (["invariant-small", "--runs", "0"], "expected a whole number > 0, got 0"),
        (["invariant-small", "--jobs", "two"], "expected a whole number > 0, got two"),
    ],
)
def test_unusable_arguments(arguments: list[str], complaint: str) -> None:
    done = usblnav("study", *arguments)
    assert done.returncode == 2
    assert complaint in done.stderr.decode()


def test_the_command_knows_every_study() -> None:
    text = " ".join(usblnav("study", "--help").stdout.decode().split())
    assert f"NAME {', '.join(STUDIES)}" in text


def test_no_scheduler_is_one_line() -> None:
    with pytest.raises(UsblnavError, match="no scheduler at nonsense://1"):
        Workers(dask="nonsense://1").map(where, (), 1, "nothing")


@contextmanager
def cluster(tmp_path: Path, worker_path: Path) -> Iterator[str]:
    """Address of a scheduler with two worker processes that look for modules in a folder first."""
    file = tmp_path / "scheduler.json"
    file_option = ["--scheduler-file", str(file), "--no-dashboard"]
    roles = [
        ["scheduler", "--host", "127.0.0.1", "--port", "0", *file_option],
        *[["worker", "--nthreads", "1", "--no-nanny", *file_option]] * 2,
    ]
    environment = os.environ | {"PYTHONPATH": str(worker_path)}
    with ExitStack() as stack:
        for role in roles:
            log = stack.enter_context((tmp_path / f"{role[0]}.log").open("ab"))
            process = subprocess.Popen(
                [*DASK, *role], cwd=tmp_path, env=environment, stdout=log, stderr=log
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
            while not file.exists():
                process.poll()
                assert process.returncode is None, (tmp_path / f"{role[0]}.log").read_text()
        yield json.loads(file.read_text())["address"]


def where(seed: int) -> int:
    """Process of a run."""
    return os.getpid()


def test_a_worker_without_usblnav_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "gateway.py").write_text("# something else of that name")
    complaint = (
        r"^--dask: worker tcp://127\.0\.0\.1:\d+ cannot import usblnav: No module named [^\n]+$"
    )
    with cluster(tmp_path, tmp_path) as address, pytest.raises(UsblnavError, match=complaint):
        Workers(dask=address).map(where, (), 1, "where")


def test_a_cluster_gives_what_this_machine_gives(tmp_path: Path) -> None:
    of = voyage.make(short("invariant", 30.0))
    shared = (of, {"additive": {"error": "additive"}})
    near = Workers(1).map(invariant.one, shared, 4, "short")
    with cluster(tmp_path, ROOT) as address:
        far = Workers(dask=address).map(invariant.one, shared, 4, "short")
        processes = set(Workers(dask=address).map(where, (), 20, "where"))
    for one, other in zip(far, near, strict=True):
        assert np.array_equal(one["additive"].error_n, other["additive"].error_n)
        assert np.array_equal(one["additive"].nis, other["additive"].nis)
    assert os.getpid() not in processes
    assert 1 <= len(processes) <= 2
