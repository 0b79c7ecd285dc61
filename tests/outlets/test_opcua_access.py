"""Who is let in to the OPC UA server, and by which ways nobody is."""

from __future__ import annotations

import subprocess
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import UserRole
from asyncua.crypto.security_policies import (
    SecurityPolicyAes128Sha256RsaOaep,
    SecurityPolicyAes256Sha256RsaPss,
    SecurityPolicyBasic256Sha256,
)
from asyncua.crypto.uacrypto import CertProperties
from pydantic import ValidationError

from observer.config.outlets import Opcua
from observer.errors import ConfigError
from observer.outlets.opcua_server import _Guarded, _Readers, guarded
from tests.bus.people import secret
from tests.bus.router import free_port
from tests.docs.console import blocks
from tests.outlets.applications import PAGE, application, made_as_on_the_page
from tests.outlets.feeding import OutletsFeed, fed_outlets
from tests.outlets.nodes import node_of
from tests.patience import eventually

pytestmark = pytest.mark.system
POLICIES = (SecurityPolicyBasic256Sha256, SecurityPolicyAes128Sha256RsaOaep, SecurityPolicyAes256Sha256RsaPss)


@dataclass(frozen=True)
class Served:
    """A server as on the page, but on loopback, and what a client of its plant has."""

    folder: Path
    url: str
    password: str
    feed: OutletsFeed

    async def client(
        self, policy=SecurityPolicyBasic256Sha256, mode=ua.MessageSecurityMode.SignAndEncrypt
    ) -> Client:
        """A client that encrypts and has not yet said who it is."""
        client = Client(self.url, timeout=10)
        key = CertProperties(self.folder / "scada.key", "pem")
        server = CertProperties(self.folder / "opcua.pem", "pem")
        certificate = self.folder / "scada.pem"
        await client.set_security(policy, certificate, key, server_certificate=server, mode=mode)
        return client

    async def known(self, **more) -> Client:
        """One that gives the right name and password."""
        client = await self.client(**more)
        client.set_user("scada")
        client.set_password(self.password)
        return client


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("plant")
    made_as_on_the_page(made)
    application(made, "scada")
    return made


def _settings(folder: Path) -> Opcua:
    """The page's own table, on loopback and with the files of a folder."""
    (table,) = [t["opcua"] for t in _tables() if "users_file" in t.get("opcua", {})]
    keys = ("users_file", "certificate", "key")
    files = {key: folder / Path(table[key]).name for key in keys}
    assert Opcua(**table)
    return Opcua(listen=f"opc.tcp://127.0.0.1:{free_port()}", **files)


def _tables() -> Iterator[dict]:
    return (tomllib.loads(body) for _, language, body in blocks(PAGE) if language == "toml")


@contextmanager
def _serving(folder: Path) -> Iterator[Served]:
    settings = _settings(folder)
    password = settings.users_file.read_text().strip().partition(":")[2]
    with fed_outlets(opcua=settings) as feed:
        said = feed.said()
        assert said["reason"] is None, said
        feed.estimate()
        yield Served(folder, settings.listen, password, feed)


@pytest.fixture(scope="module")
def served(folder) -> Iterator[Served]:
    with _serving(folder) as server:
        yield server


async def _value(client: Client) -> float:
    """The heat, of whatever quality it is."""
    heat = await node_of(client)
    return (await heat.read_data_value(raise_on_bad_status=False)).Value.Value


async def test_with_the_password_a_client_reads_and_subscribes_and_cannot_write(served):
    for policy in POLICIES:
        async with await served.known(policy=policy) as client:
            assert await _value(client) == 26.5
            with pytest.raises(ua.UaError):
                await (await node_of(client)).write_value(5.0)
            assert await _value(client) == 26.5
    heard: list[tuple[float, int]] = []

    class Handler:
        def datachange_notification(self, _node, value, data):
            heard.append((value, data.monitored_item.Value.StatusCode.value))

    async with await served.known() as client:
        subscription = await client.create_subscription(50, Handler())
        await subscription.subscribe_data_change(await node_of(client))
        await eventually(lambda: heard == [(26.5, ua.StatusCodes.Good)])
        served.feed.estimate("degraded")
        await eventually(lambda: heard[1:] == [(26.5, ua.StatusCodes.UncertainSubNormal)])


@pytest.mark.parametrize("fault", ["wrong password", "nobody's name", "anonymous", "signed only"])
async def test_a_client_without_password_or_encryption_is_refused(served, fault):
    if fault == "signed only":
        client = await served.known(mode=ua.MessageSecurityMode.Sign)
        client.uaclient._timeout = 1.0  # the server does not answer
        with pytest.raises((TimeoutError, ConnectionError, ua.UaError)):
            await client.connect()
        return
    client = await served.client()
    if fault != "anonymous":
        client.set_user("scada" if fault == "wrong password" else "ben")
        client.set_password("wrong" if fault == "wrong password" else served.password)
    with pytest.raises(ua.UaError):
        await client.connect()
    async with await served.known() as client:
        assert await _value(client) == 26.5


async def _opened(client: Client) -> Client:
    """A connection without a session yet."""
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    return client


def _login(name: str, password: str) -> ua.ActivateSessionParameters:
    token = ua.UserNameIdentityToken(PolicyId="username", UserName=name, Password=password.encode())
    return ua.ActivateSessionParameters(UserIdentityToken=token)


async def _cannot_read(client: Client, node: ua.NodeId) -> None:
    with pytest.raises(ua.UaError):
        await client.get_node(node).read_data_value(raise_on_bad_status=False)
    client.disconnect_socket()


async def test_nobody_reads_without_encryption_even_with_password_or_another_session(served):
    async with await served.known() as own:
        node = (await node_of(own)).nodeid
        client = Client(served.url)
        client.set_user("scada")
        client.set_password(served.password)
        with pytest.raises(ua.UaError, match="No matching endpoint"):
            await client.connect()

        ends = await Client(served.url).connect_and_get_server_endpoints()
        assert {end.SecurityMode for end in ends} == {ua.MessageSecurityMode.SignAndEncrypt}
        assert {end.Server.ApplicationUri for end in ends} == {"urn:lathe-7:ballscrew-observer"}
        assert {t.TokenType for end in ends for t in end.UserIdentityTokens} == {ua.UserTokenType.UserName}

        client = await _opened(Client(served.url))  # a client that does not look at the endpoints
        await client.uaclient.create_session(ua.CreateSessionParameters(RequestedSessionTimeout=60_000))
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await client.uaclient.activate_session(_login("scada", served.password))
        await _cannot_read(client, node)

        for another in (Client(served.url), await served.client()):
            await _opened(another)
            another.uaclient.session.restore_authentication_token(own.uaclient.session.authentication_token)
            with pytest.raises(ua.UaError):
                await another.uaclient.activate_session(_login("ben", "wrong"))
            await _cannot_read(another, node)


async def test_nobody_makes_the_server_a_directory_of_others(served):
    client = await _opened(Client(served.url))
    server = ua.RegisteredServer(ServerUri="urn:evil", ServerNames=[ua.LocalizedText("evil")])
    with pytest.raises(ua.UaError):
        await client.uaclient.register_server(server)
    found = await client.uaclient.find_servers(ua.FindServersParameters(EndpointUrl=served.url))
    assert [s.ApplicationUri for s in found] == ["urn:lathe-7:ballscrew-observer"]
    client.disconnect_socket()


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"listen": "opc.tcp://0.0.0.0:4840"}, "have to log in"),
        ({"listen": "opc.tcp://[::]:4840", "certificate": "c", "key": "k"}, "have to log in"),
        ({"listen": "opc.tcp://lathe-7:4840", "users_file": "u"}, "in the clear"),
        ({"users_file": "u"}, "in the clear"),
        ({"certificate": "c"}, "certificate and key belong together"),
        ({"users_file": "u", "certificate": "c", "key": "k", "anonymous": True}, "one of them"),
        ({"listen": "127.0.0.1:4840"}, "opc.tcp://127.0.0.1:4840"),
        ({"listen": "opc.tcp://127.0.0.1"}, "host:port"),
    ],
)
def test_settings_that_would_admit_anybody_unasked_are_rejected(table, sentence):
    with pytest.raises(ValidationError, match=sentence):
        Opcua(**table)


def test_everybody_is_let_in_where_that_is_said():
    assert Opcua(listen="opc.tcp://0.0.0.0:4840", anonymous=True).users_file is None


def _pair(folder: Path, *kind: str, mode: int = 0o600) -> dict[str, Path]:
    """A certificate of an unwonted kind with its key."""
    command = ("openssl", "req", "-x509", *kind, "-subj", "/CN=odd", "-keyout", "odd.key", "-out", "odd.pem")
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (folder / "odd.key").chmod(mode)
    return {"certificate": folder / "odd.pem", "key": folder / "odd.key"}


_RSA = ("-newkey", "rsa:2048")
_EC = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda f: {"certificate": f / "none"}, "opcua.certificate: .* cannot be read"),
        (lambda f: {"users_file": f / "none"}, "opcua.users_file: .* cannot be read"),
        (lambda f: {"certificate": secret(f / "text", "hello")}, "not a certificate and a key"),
        (lambda f: {"certificate": f / "scada.pem"}, "is not the key of"),
        (lambda f: _pair(f, *_EC), "RSA with 2048 bits"),
        (lambda f: _pair(f, "-newkey", "rsa:1024", "-nodes"), "RSA with 2048 bits"),
        (lambda f: _pair(f, *_RSA, "-passout", "pass:word"), "without a passphrase"),
        (lambda f: _pair(f, *_RSA, "-nodes", mode=0o640), "chmod 600"),
    ],
)
async def test_unusable_files_are_reported_in_a_sentence(folder, wrong, sentence):
    settings = _settings(folder)
    with pytest.raises(ConfigError, match=sentence):
        await guarded(settings.model_copy(update=wrong(folder)))


def test_even_without_names_a_server_with_a_certificate_admits_clients_that_encrypt():
    readers = _Readers(None, encrypted=True)
    assert readers.get_user(None, certificate=b"") is None
    assert readers.get_user(None, certificate=b"any").role is UserRole.User


def test_a_password_in_a_padding_whose_errors_leak_the_key_is_not_even_looked_at():
    server = _Guarded(_Readers(None, encrypted=True))
    token = ua.UserNameIdentityToken(EncryptionAlgorithm="http://www.w3.org/2001/04/xmlenc#rsa-1_5")
    with pytest.raises(ServiceError):
        server.decrypt_user_token(None, token)


async def test_after_five_wrong_passwords_the_right_one_waits(folder):
    with _serving(folder) as served:
        async with await served.known():
            pass
        for _ in range(5):
            client = await served.client()
            client.set_user("scada")
            client.set_password("wrong")
            with pytest.raises(ua.UaError):
                await client.connect()
        with pytest.raises(ua.UaError):
            await (await served.known()).connect()
