"""Settings in Zenoh's own words: taken as they are, refused by their path, and never a secret."""

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from gateway.cli import main
from gateway.config import ZenohOutput, ZenohRos, ZenohTls
from gateway.outputs.zenoh.settings import configuration, faults
from gateway.schema import build
from tests.gateway.configurations import edited, written
from tests.shared_data import ROOT


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"modee": 1}, "modee: unknown key"),
        ({"mode": "peer"}, "mode: is set by mode of the output itself"),
        (
            {"transport": {"link": {"tls": {"close_link": True}, "tx": {"lease": 5000}}}},
            "transport.link.tls.close_link: unknown key",
        ),
        (
            {"transport": {"unicast": {"lowlatency": 3}}},
            "transport.unicast.lowlatency: invalid type: integer `3`, expected a boolean",
        ),
        (
            {"connect": {"timeout_ms": {"peer": "soon"}}},
            "connect.timeout_ms: error parsing number",
        ),
        (
            {"access_control": {"enabled": True, "default_permission": "no"}},
            "access_control.default_permission: unknown variant `no`, expected `allow` or `deny`",
        ),
        (
            {"transport": {"auth": {"usrpwd": {"user": "auv1", "password": "secret"}}}},
            "transport.auth.usrpwd: is set by user, password_file and users_file"
            " of the output itself",
        ),
        (
            {"transport": {"link": {"tls": {"connect_private_key_base64": "c2VjcmV0"}}}},
            "transport.link.tls.connect_private_key_base64: secrets stand in files of their own",
        ),
    ],
)
def test_what_zenoh_would_not_take(config: dict[str, Any], said: str) -> None:
    (fault,) = faults(ZenohOutput(config=config), "outputs[1]")
    assert fault == f"outputs[1].config.{said}"


def test_settings_of_zenoh_stand_beside_ours(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("secret\n")
    (tmp_path / "ca.pem").touch()
    settings = ZenohOutput(
        mode="client",
        connect=("tls/router:7447",),
        tls=ZenohTls(root_ca=str(tmp_path / "ca.pem"), verify_name=False),
        user="auv1",
        password_file=str(tmp_path / "password"),
        config={
            "transport": {"link": {"tx": {"lease": 5000}, "tls": {"so_sndbuf": 4096}}},
            "connect": {"timeout_ms": {"client": 0}},
        },
    )
    assert list(faults(settings, "outputs[0]")) == []
    tree = json.loads(str(configuration(settings)))
    link, known = tree["transport"]["link"], tree["transport"]["auth"]["usrpwd"]
    assert tree["mode"] == "client"
    assert tree["connect"]["endpoints"] == ["tls/router:7447"]
    assert tree["connect"]["timeout_ms"] == {"client": 0}
    assert (link["tx"]["lease"], link["tls"]["so_sndbuf"]) == (5000, 4096)
    assert link["tls"]["root_ca_certificate"] == str(tmp_path / "ca.pem")
    assert link["tls"]["verify_name_on_connect"] is False
    assert tree["scouting"]["multicast"]["enabled"] is False
    assert (known["user"], known["password"]) == ("auv1", "secret")


def test_check_names_them_with_files_that_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = {
        "type": "zenoh",
        "tls": {"root_ca": "/nowhere/ca.pem"},
        "config": {"transport": {"unicast": {"max_link": 1}}},
    }
    file = written(tmp_path, edited(("outputs", [output])))
    assert main(["check", str(file)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[2] for line in said] == [
        "outputs[0].config.transport.unicast.max_link: unknown key",
        "outputs[0].tls.root_ca: /nowhere/ca.pem: no such file or directory",
    ]
    assert main(["run", "-c", str(file)]) == 2
    assert "max_link: unknown key" in capsys.readouterr().err


DOCS = (ROOT / "docs/outputs.md").read_text().partition("\n## Zenoh\n")[2].partition("\n## ")[0]


def documented(block: str) -> list[dict[str, Any]]:
    """Outputs of a YAML block of the docs; one without a list goes on from the one before."""
    data = yaml.safe_load(block)
    return data.get("outputs", [{"type": "zenoh", **data}])


def test_documented_outputs_have_no_fault() -> None:
    outputs = [
        output
        for block in re.findall(r"(?ms)^```yaml\n(.*?)^```$", DOCS)
        for output in documented(block)
    ]
    assert len(outputs) >= 6
    said: list[str] = []
    for output in outputs:
        settings = build(ZenohOutput, output, said, "outputs[0]")
        assert settings is not None, said
        said += faults(settings, "outputs[0]")
    assert said == []


@pytest.mark.parametrize(
    ("first", "block"), [("setting", ZenohOutput), ("`tls`", ZenohTls), ("`ros`", ZenohRos)]
)
def test_every_setting_is_documented(first: str, block: type[msgspec.Struct]) -> None:
    rows = DOCS.partition(f"\n| {first} | default | |\n")[2].partition("\n\n")[0]
    names = set(re.findall(r"`(\w+)`", " ".join(re.findall(r"(?m)^\| (`.*?`) \|", rows))))
    assert names == {field.encode_name for field in msgspec.structs.fields(block)}
