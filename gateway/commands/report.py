"""`usblnav report`: a page of figures about a replay or a recording."""

import tempfile
from argparse import Namespace
from pathlib import Path

from gateway.commands import tapes


def run(arguments: Namespace) -> int:
    """Write the page, and say where."""
    paths: list[Path] = arguments.results
    out = arguments.out or (paths[0] if paths[0].is_dir() else paths[0].parent) / "report.html"
    if len(paths) == 1 and _is_of_results(paths[0]):
        _write(paths[0], arguments.truth, out)
    else:
        recordings = tapes.named(paths)
        from gateway.recording.export import export  # after the check: it takes a while to import

        with tempfile.TemporaryDirectory(prefix="usblnav-report-") as exported:
            tapes.tell_damage(export(recordings, Path(exported)))
            _write(Path(exported), arguments.truth, out)
    print(f"report in {out}")
    return 0


def _is_of_results(path: Path) -> bool:
    """Whether it is a folder of tables, or at least holds no recording."""
    return path.is_dir() and ((path / "nav.csv").is_file() or not any(path.glob("*.mcap")))


def _write(folder: Path, truth: Path | None, out: Path) -> None:
    from gateway import report  # after the check: it takes a second to import

    report.write(report.read(folder, truth), out)
