"""`usblnav report`: a page of figures about a replay or a recording."""

import tempfile
from argparse import Namespace
from pathlib import Path

from gateway.errors import ConfigError


def run(arguments: Namespace) -> int:
    """Write the page, and say where."""
    paths: list[Path] = arguments.results
    absent = [f"{path}: no such file or folder" for path in paths if not path.exists()]
    if absent:
        raise ConfigError(absent)
    out = arguments.out or (paths[0] if paths[0].is_dir() else paths[0].parent) / "report.html"
    tapes = _tapes(paths)
    if not tapes:
        (folder,) = paths
        _write(folder, arguments.truth, out)
    else:
        from gateway.recording.export import export  # after the check: it takes a while to import

        with tempfile.TemporaryDirectory(prefix="usblnav-report-") as exported:
            export(tapes, Path(exported))
            _write(Path(exported), arguments.truth, out)
    print(f"report in {out}")
    return 0


def _tapes(paths: list[Path]) -> list[Path]:
    """The files of a recording, by their names or their folder; none for the folder of a replay."""
    if len(paths) == 1 and paths[0].is_dir():
        return [] if (paths[0] / "nav.csv").is_file() else sorted(paths[0].glob("*.mcap"))
    folders = [f"{path}: a folder; give one alone" for path in paths if path.is_dir()]
    if folders:
        raise ConfigError(folders)
    return paths


def _write(folder: Path, truth: Path | None, out: Path) -> None:
    from gateway import report  # after the check: it takes a second to import

    report.write(report.read(folder, truth), out)
