"""Zenoh behind TLS, passwords and access control: who belongs here gets in, others are told why."""

import asyncio
import subprocess
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh

from gateway.config import ZenohOutput, ZenohTls
from gateway.outputs.zenoh import ask, client_of, open_publisher
from tests.integration.zenoh_ends import session
from tests.loopback import free_endpoint, until

pytestmark = pytest.mark.live

PASSWORD = "correct horse"
KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


class Authority:
    """Makes certificates in a folder, signed by itself."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name
        self.certificate = str(folder / f"{name}.pem")
        self._openssl(name, "-addext", "basicConstraints=critical,CA:TRUE")

    def sign(self, name: str, **more: Any) -> ZenohTls:
        """Give a party what it needs."""
        alternative = "subjectAltName=DNS:localhost,IP:127.0.0.1"
        signer = ("-CA", self.certificate, "-CAkey", f"{self._folder}/{self._name}.key")
        self._openssl(name, "-addext", alternative, *signer)
        own = {"certificate": f"{self._folder}/{name}.pem", "private_key": self._key(name)}
        return ZenohTls(root_ca=self.certificate, **own, **more)

    def _key(self, name: str) -> str:
        return f"{self._folder}/{name}.key"

    def _openssl(self, name: str, *options: str) -> None:
        files = ("-keyout", self._key(name), "-out", f"{self._folder}/{name}.pem")
        named = ("-subj", f"/CN={name}", "-config", str(self._folder / "config"))
        (self._folder / "config").write_text("[req]\ndistinguished_name = name\n[name]\n")
        command = ["openssl", "req", "-x509", "-days", "2", *KEY, *named, *files, *options]
        subprocess.run(command, check=True, capture_output=True)


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("ours"), "authority")


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("theirs"), "stranger")


@pytest.fixture(autouse=True)
def everything_said(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("DEBUG")


def client(endpoint: str, **settings: Any) -> ZenohOutput:
    return ZenohOutput(mode="client", connect=(endpoint,), **settings)


async def hears(
    router: ZenohOutput, vehicle: ZenohOutput, ear: str, **transport: Any
) -> zenoh.Sample:
    """What another client of the router hears of a vehicle."""
    heard: list[zenoh.Sample] = []
    async with open_publisher(router, "ship"), open_publisher(vehicle, "auv1") as publisher:
        await until(lambda: publisher.status().up)
        with session(ear, **transport) as there:
            held = there.declare_subscriber("usblnav/auv1/*", heard.append)
            await until(lambda: heard, lambda: publisher.publish("status", {"mode": "aided"}))
            held.undeclare()
    return heard[0]


async def said_of(router: ZenohOutput, vehicle: ZenohOutput) -> str:
    """The state of a vehicle's output that its router does not let in."""
    async with open_publisher(router, "ship"), open_publisher(vehicle, "auv1") as publisher:
        await until(lambda: publisher.status().error)
        assert not publisher.status().up
        return publisher.status().error


async def test_certificates_of_one_authority_meet(ours: Authority) -> None:
    inside, endpoint = free_endpoint(), free_endpoint("tls")
    listen = (endpoint, inside)
    router = ZenohOutput(mode="router", listen=listen, tls=ours.sign("router", mutual=True))
    vehicle = client(endpoint, tls=ours.sign("auv1", mutual=True))
    sample = await hears(router, vehicle, inside)
    assert sample.payload.to_string() == '{"mode":"aided"}'


async def test_a_gateway_behind_certificates_is_asked_by_its_own_settings(ours: Authority) -> None:
    endpoint = free_endpoint("tls")
    router = ZenohOutput(mode="router", listen=(endpoint,), tls=ours.sign("ship", mutual=True))
    async with open_publisher(router, "ship") as publisher:
        publisher.publish("status", {"mode": "aided"})
        answers = await asyncio.to_thread(ask, client_of(router), "usblnav/*/status")
    assert answers == {"usblnav/ship/status": b'{"mode":"aided"}'}


async def test_a_router_of_another_authority_is_refused(ours: Authority, theirs: Authority) -> None:
    endpoint = free_endpoint("tls")
    router = ZenohOutput(mode="router", listen=(endpoint,), tls=theirs.sign("router"))
    said = await said_of(router, client(endpoint, tls=ours.sign("auv1")))
    assert said.startswith(f"{endpoint}: its certificate is refused: ")


async def test_a_vehicle_of_another_authority_is_refused(
    ours: Authority, theirs: Authority
) -> None:
    endpoint = free_endpoint("tls")
    router = ZenohOutput(mode="router", listen=(endpoint,), tls=ours.sign("router", mutual=True))
    tls = msgspec.structs.replace(theirs.sign("auv1", mutual=True), root_ca=ours.certificate)
    said = await said_of(router, client(endpoint, tls=tls))
    assert said.startswith(f"{endpoint}: no TLS with it: ")


async def test_a_missing_certificate_is_one_line_and_waited_for(
    ours: Authority, tmp_path: Path
) -> None:
    endpoint, late = free_endpoint("tls"), tmp_path / "ca.pem"
    router = ZenohOutput(mode="router", listen=(endpoint,), tls=ours.sign("router"))
    vehicle = client(endpoint, tls=ZenohTls(root_ca=str(late)))
    async with open_publisher(router, "ship"), open_publisher(vehicle, "auv1") as publisher:
        assert publisher.status().error == f"tls.root_ca: {late}: no such file or directory"
        late.symlink_to(ours.certificate)
        await until(lambda: publisher.status().up)


@pytest.fixture
def users(tmp_path: Path) -> dict[str, str]:
    """A router's list of users, and a right and a wrong password of the first."""
    known = f"auv1:{PASSWORD}\nplotter:chart\npilot:boat\n"
    files = {"users": known, "right": f"{PASSWORD}\n", "wrong": "wrong horse\n"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return {name: str(tmp_path / name) for name in files}


async def test_a_user_with_its_password_gets_in(
    users: dict[str, str], caplog: pytest.LogCaptureFixture
) -> None:
    endpoint = free_endpoint()
    router = ZenohOutput(mode="router", listen=(endpoint,), users_file=users["users"])
    vehicle = client(endpoint, user="auv1", password_file=users["right"])
    auth = {"usrpwd": {"user": "auv1", "password": PASSWORD}}
    assert (await hears(router, vehicle, endpoint, auth=auth)).payload
    assert "horse" not in caplog.text


@pytest.mark.parametrize("mode", ["client", pytest.param("peer", marks=pytest.mark.slow)])
async def test_a_wrong_password_is_one_clear_line(
    mode: Any, users: dict[str, str], caplog: pytest.LogCaptureFixture
) -> None:
    endpoint = free_endpoint()
    router = ZenohOutput(mode="router", listen=(endpoint,), users_file=users["users"])
    vehicle = client(endpoint, user="auv1", password_file=users["wrong"])
    said = await said_of(router, msgspec.structs.replace(vehicle, mode=mode))
    assert said == f"{endpoint}: answers, but gives no session: wrong password of auv1?"
    assert [m for m in caplog.messages if "trying again" in m] == [
        f"output zenoh {mode}: {said}; trying again"
    ]
    assert "horse" not in caplog.text


async def test_nobody_gets_in_without_a_user(users: dict[str, str]) -> None:
    endpoint = free_endpoint()
    router = ZenohOutput(mode="router", listen=(endpoint,), users_file=users["users"])
    said = await said_of(router, client(endpoint))
    why = "does it want a certificate, or a user and password?"
    assert said == f"{endpoint}: answers, but gives no session: {why}"


async def test_who_may_not_hear_a_key_does_not(users: dict[str, str]) -> None:
    endpoint, stray = free_endpoint(), free_endpoint()
    rules = {
        "access_control": {
            "enabled": True,
            "default_permission": "allow",
            "rules": [
                {
                    "id": "no calibration",
                    "permission": "deny",
                    "flows": ["egress"],
                    "messages": ["put", "reply"],
                    "key_exprs": ["usblnav/*/calibration"],
                }
            ],
            "subjects": [{"id": "plotter", "usernames": ["plotter"]}],
            "policies": [{"rules": ["no calibration"], "subjects": ["plotter"]}],
        }
    }
    router = ZenohOutput(
        mode="router", listen=(endpoint, stray), users_file=users["users"], config=rules
    )
    vehicle = client(endpoint, user="auv1", password_file=users["right"])
    heard: dict[str, set[str]] = {"plotter": set(), "pilot": set()}
    async with open_publisher(router, "ship"), open_publisher(vehicle, "auv1") as publisher:
        await until(lambda: publisher.status().up)

        def publish() -> None:
            publisher.publish("calibration", {"constants": {}})
            publisher.publish("status", {"mode": "aided"})

        async def listen(user: str, password: str) -> None:
            with session(endpoint, auth={"usrpwd": {"user": user, "password": password}}) as there:
                held = there.declare_subscriber(
                    "usblnav/auv1/*", lambda sample: heard[user].add(str(sample.key_expr))
                )
                await until(lambda: "usblnav/auv1/status" in heard[user], publish)
                for reply in await asyncio.to_thread(lambda: list(there.get("usblnav/auv1/*"))):
                    if reply.ok:
                        heard[user].add(f"asked {reply.ok.key_expr}")
                held.undeclare()

        await listen("pilot", "boat")
        await listen("plotter", "chart")
    calibration = {"usblnav/auv1/calibration", "asked usblnav/auv1/calibration"}
    assert calibration <= heard["pilot"]
    assert not calibration & heard["plotter"]
    assert heard["plotter"] == heard["pilot"] - calibration
