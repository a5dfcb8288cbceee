"""The C program of the docs, compiled with zenoh-pico or zenoh-c, beside a running gateway.

``pytest -m slow tests/integration/test_zenoh_in_c.py``
"""

import asyncio
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.integration.rig import Rig
from tests.shared_data import ROOT

pytestmark = [pytest.mark.live, pytest.mark.slow]


def flags(library: str) -> list[str]:
    """What the compiler is to be told; skips the test where the library is not installed."""
    if not (shutil.which("cc") and shutil.which("pkg-config")):
        pytest.skip("no C compiler, or no pkg-config")
    if subprocess.run(["pkg-config", "--exists", library], check=False).returncode:
        pytest.skip(f"pkg-config knows no {library}")
    options = ("--cflags", "--libs"), ("--variable=prefix",)
    asked = [["pkg-config", *option, library] for option in options]
    told, prefix = (subprocess.check_output(command, text=True).strip() for command in asked)
    return [*told.split(), f"-Wl,-rpath,{prefix}/lib"]


def compiled(source: Path, options: list[str]) -> Path:
    """The program of a source, in which the compiler finds nothing to complain of."""
    built = source.with_suffix("")
    strict = ("-std=c11", "-Wall", "-Wextra", "-Werror")
    subprocess.run(["cc", *strict, source, *options, "-o", built], check=True)
    return built


@pytest.mark.parametrize(("library", "more"), [("zenohpico", ["-DZENOH_LINUX"]), ("zenohc", [])])
async def test_the_documented_program_hears_the_vehicle(
    library: str, more: list[str], tmp_path: Path
) -> None:
    found = flags(library)
    (program,) = re.findall(r"(?s)```c\n(.*?)```", (ROOT / "docs/outputs.md").read_text())
    rig = Rig(tmp_path)
    source = tmp_path / "listen.c"
    source.write_text(program.replace("tcp/127.0.0.1:7447", rig.endpoint))
    assert rig.endpoint in source.read_text()
    built = compiled(source, [*more, *found])
    async with rig.gateway(), rig.emulator():
        rig.hear_zenoh()
        await rig.until("a true position", rig.is_right)
        pipe = asyncio.subprocess.PIPE
        listener = await asyncio.create_subprocess_exec(
            *("stdbuf", "-oL", built), stdin=pipe, stdout=pipe
        )
        assert listener.stdout is not None
        said = [await asyncio.wait_for(listener.stdout.readline(), 15) for _ in range(10)]
        await asyncio.wait_for(listener.communicate(b"\n"), 15)
        last = json.loads(said[-1].split(maxsplit=1)[1])
        await rig.until("the same", lambda: rig.navs[-1].utc_ns >= last["utc_ns"])
    assert listener.returncode == 0
    navs = {nav.utc_ns: nav for nav in rig.navs}
    for line in said:
        key, _, payload = line.decode().partition(" ")
        heard = json.loads(payload)
        assert key == f"usblnav/{rig.scenario['vehicle']}/nav"
        assert (heard["mode"], heard["lat_deg"]) == (
            navs[heard["utc_ns"]].mode,
            navs[heard["utc_ns"]].lat_deg,
        )
