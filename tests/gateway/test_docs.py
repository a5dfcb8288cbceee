"""Every command and every configuration of the docs is one that the program takes; links lead."""

import argparse
import ast
import contextlib
import io
import os
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from gateway import cli
from gateway.arguments import command_line
from gateway.commands.linktext import read_link
from gateway.config import NmeaOutput, load
from gateway.errors import ConfigError
from tests.shared_data import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
ELSEWHERE = {
    *("apt", "systemctl", "systemd-sysusers", "systemd-tmpfiles", "udevadm", "userdel"),
    *("journalctl", "gpsd", "npm", "rm", "ls", "printf", "python3", "pip", "git", "cd"),
}
"""Programs of others, whose arguments are their own affair."""
ABRIDGED = re.compile(r"are required|expected one argument|invalid choice: '[A-Z]+'")
"""What may be said against one in running text: it lacks arguments, or has one in CAPITALS."""
RUN_BY = {
    **dict.fromkeys(
        ("calibrate", "codecs", "decode", "emulate", "replay", "report", "run", "study"),
        "integration/test_readme.py",
    ),
    "check": "integration/test_entry_points.py",
    "demo": "integration/test_demo.py",
    "export": "integration/test_recording.py",
    "monitor": "integration/test_monitor.py",
    "status": "integration/test_daemon.py",
}
"""The test that runs each of our own commands as a process."""


def blocks(page: Path, language: str) -> list[str]:
    found = re.findall(rf"(?ms)^( *)```{language}\n(.*?)^ *```$", page.read_text(encoding="utf-8"))
    return [re.sub(rf"(?m)^{indent}", "", block) for indent, block in found]


def commands(page: Path) -> Iterator[str]:
    """Each command of the shell's blocks, a here-document with its first line."""
    for block in blocks(page, "sh"):
        lines = iter(block.splitlines())
        for line in lines:
            if not line.strip() or line.startswith("#"):
                continue
            if told := re.search(r"<<'(\w+)'$", line):
                body = iter(lambda lines=lines: next(lines), told[1])
                line = "\n".join([line, *body])
            yield line.strip()


def unfenced(page: Path) -> str:
    return re.sub(r"(?ms)^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"))


def inline(page: Path) -> list[str]:
    """Those in running text."""
    found = re.findall(
        r"`((?:usblnav [a-z]|python -m tests|scripts/|pytest )[^`]*)`", unfenced(page)
    )
    return [command.replace("\n", " ") for command in found]


COMMANDS = [(page.name, command) for page in PAGES for command in commands(page)]
INLINE = [(page.name, command) for page in PAGES for command in inline(page)]


def faults(command: str, *, whole: bool) -> list[str]:
    """What the program, or the checkout, says against a command; one in text may be abridged."""
    first, _, body = command.partition("\n")
    if body:
        ast.parse(body)
        first = first.partition("<<")[0]
    found: list[str] = []
    words = shlex.split(first, comments=True)
    for k in range(words.count("|") + words.count("&&") + 1):
        found += _simple([*_split(words)][k], whole=whole)
    return found


def _split(words: list[str]) -> Iterator[list[str]]:
    part: list[str] = []
    for word in words:
        if word in ("|", "&&"):
            yield part
            part = []
        else:
            part.append(word)
    yield part


def _simple(words: list[str], *, whole: bool) -> list[str]:
    while "=" in words[0] and not words[0].startswith("-"):
        words = words[1:]
    if words[0] == "runuser":
        words = words[words.index("--") + 1 :]
    program, arguments = Path(words[0]).name, words[1:]
    if program == "usblnav":
        return _ours(arguments, whole=whole)
    if program in ("python", "pytest") or words[0].startswith("scripts/"):
        return _of_checkout(words)
    if program == "install":
        return [] if (ROOT / arguments[1]).is_file() else [f"{arguments[1]}: no such file"]
    return [] if program in ELSEWHERE else [f"nothing checks {program}"]


def _ours(arguments: list[str], *, whole: bool) -> list[str]:
    said = io.StringIO()
    with (
        contextlib.redirect_stderr(said),
        contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO())),
    ):
        try:
            parsed = command_line().parse_args(arguments)
            if whole and parsed.command == "decode":
                return _decode(parsed)
        except SystemExit as ended:
            if ended.code:
                fault = said.getvalue().splitlines()[-1]
                return [] if ABRIDGED.search(fault) and not whole else [fault]
    return []


def _decode(parsed: argparse.Namespace) -> list[str]:
    """The link is one, and codec and options decode nothing at all without a complaint."""
    try:
        if parsed.link is not None:
            read_link(parsed.link, "--link")
    except ConfigError as error:
        return error.faults
    options = [word for pair in parsed.options for word in ("-o", pair)]
    code = cli.main(["decode", "--codec", parsed.codec, *options, os.devnull])
    return [] if code == 0 else [f"decode: exit code {code}"]


def _of_checkout(words: list[str]) -> list[str]:
    """Files and modules are there, and the module knows the options."""
    missing = [
        f"{word}: no such file"
        for word in words
        if word.startswith(("tests/", "scripts/")) and not (ROOT / word).exists()
    ]
    if words[:2] != ["python", "-m"]:
        return missing
    module = ROOT / words[2].replace(".", "/")
    source = module / "__main__.py" if module.is_dir() else module.with_suffix(".py")
    if not source.is_file():
        return [f"{words[2]}: no such module"]
    text = source.read_text(encoding="utf-8")
    return missing + [
        f"{words[2]}: no option {word}"
        for word in words[3:]
        if word.startswith("--") and f'"{word}"' not in text
    ]


@pytest.mark.parametrize("page", [page.name for page in PAGES])
def test_every_command_is_one_that_is_there(page: str) -> None:
    found = {
        command: said
        for whole, listed in ((True, COMMANDS), (False, INLINE))
        for of, command in listed
        if of == page and (said := faults(command, whole=whole))
    }
    assert found == {}


def test_a_command_that_is_not_there_is_named() -> None:
    assert "invalid choice: 'sail'" in faults("usblnav sail", whole=False)[0]
    assert "unrecognized arguments: --fast" in faults("usblnav run -c a --fast", whole=True)[0]
    assert "required: -c" in faults("usblnav run", whole=True)[0]
    assert faults("python -m tests.soak --hours 3", whole=True) == ["tests.soak: no option --hours"]
    assert faults("pytest tests/no.py", whole=True) == ["tests/no.py: no such file"]
    assert faults("usblnav decode --codec stim300 --link tty:x", whole=True)
    assert faults("usblnav decode --codec stim300 -o gyro=x --link udp:1", whole=True)
    assert faults("make all", whole=True) == ["nothing checks make"]
    assert len(COMMANDS) > 50


def test_each_command_of_ours_is_run_as_a_process() -> None:
    parser = command_line()
    (named,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    assert set(named.choices) == set(RUN_BY)
    for name, file in RUN_BY.items():
        text = (ROOT / "tests" / file).read_text(encoding="utf-8")
        listed = "test_readme" in file and any(
            of == "README.md" and command.startswith(f"usblnav {name}") for of, command in COMMANDS
        )
        assert listed or f'"{name}"' in text, (name, file)


CONFIGURED = [
    (page, k)
    for page in ("alignment.md", "install.md", "recording.md", "targets.md", "wiring.md")
    for k in range(len(blocks(ROOT / "docs" / page, "yaml")))
]


@pytest.mark.parametrize(("page", "k"), CONFIGURED)
def test_every_configuration_is_sound(page: str, k: int, tmp_path: Path) -> None:
    """A part of one is, in its place in the packaged one."""
    block = yaml.safe_load(blocks(ROOT / "docs" / page, "yaml")[k])
    packaged: dict[str, Any] = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))
    devices = {} if "imu0" in block.get("devices", {}) else packaged["devices"]
    block["devices"] = devices | block.get("devices", {})
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(packaged | block))
    assert load(tmp_path / "config.yaml").devices.keys() == block["devices"].keys()


@pytest.mark.parametrize(("k", "count"), [(0, 4), (1, 1)])
def test_outputs_to_plotters_are_sound(k: int, count: int, tmp_path: Path) -> None:
    shutil.copy(ROOT / "config.yaml", tmp_path)
    nmea = yaml.safe_load(blocks(ROOT / "docs" / "outputs.md", "yaml")[k])
    packaged = yaml.safe_load((tmp_path / "config.yaml").read_text(encoding="utf-8"))
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(packaged | nmea))
    outputs = load(tmp_path / "config.yaml").outputs
    assert [type(output) for output in outputs] == [NmeaOutput] * count


@pytest.mark.parametrize(
    "page",
    [str(page.relative_to(ROOT)) for page in (*PAGES, *sorted((ROOT / "docs").rglob("*/*.md")))],
)
def test_every_link_leads_somewhere(page: str) -> None:
    here = ROOT / page
    missing = []
    for link in re.findall(r"\]\(([^)\s]+)\)", unfenced(here)):
        file, _, heading = link.partition("#")
        there = here.parent / file if file else here
        if link.startswith("http"):
            continue
        if not there.exists() or (heading and heading not in headings(there)):
            missing.append(link)
    assert missing == []


def headings(page: Path) -> set[str]:
    """As a page of them is linked to: small letters, no punctuation, hyphens for blanks."""
    found = re.findall(r"(?m)^#+ (.*)$", unfenced(page))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}
