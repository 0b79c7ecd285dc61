"""The OPC UA driver against real servers on loopback, in good days and bad."""

from __future__ import annotations

import asyncio
import math
import subprocess
from contextlib import asynccontextmanager

import pytest
from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.crypto.uacrypto import load_certificate
from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions

from drivers.opcua import OpcUaSettings
from tests.bus.people import secret
from tests.bus.router import free_port
from tests.drivers.harness import running
from tests.outlets.applications import application
from tests.patience import eventually

pytestmark = [
    pytest.mark.system,
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # the server's own
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
NODES = {"Position": 123.5, "Load": 40, "Name": "G54", "Array": [1.0, 2.0]}


@asynccontextmanager
async def serving(port, nodes=None):
    """A server with variables in namespace 2."""
    server = Server()
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/control")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    await server.register_namespace("urn:test")
    variables = {}
    for name, value in (NODES if nodes is None else nodes).items():
        node_id = ua.NodeId(f"Axis.X.{name}", 2)
        variables[name] = await server.nodes.objects.add_variable(node_id, f"2:{name}", value)
    await server.start()
    try:
        yield variables
    finally:
        await server.stop()


def settings(port, nodes, **more):
    channels = {
        channel: {"node": f"ns=2;s=Axis.X.{node}", **extra} for channel, (node, extra) in nodes.items()
    }
    table = {"kind": "opcua", "url": f"opc.tcp://127.0.0.1:{port}/control", "channels": channels}
    return OpcUaSettings(**(table | {"period_s": 0.05, "timeout_s": 0.5} | more))


POSITION = {"x_m": ("Position", {"scale": 1e-3, "offset": 0.1})}


STATUSES = {
    ua.StatusCodes.BadSensorFailure: "bad_sensor_failure",
    ua.StatusCodes.BadWaitingForInitialData: "bad_waiting_for_initial_data",
    ua.StatusCodes.UncertainLastUsableValue: "uncertain_last_usable_value",
    ua.StatusCodes.GoodLocalOverride: "good_local_override",
    0x0500: "under_range",
    0x0600: "over_range",
}


async def test_only_plain_good_is_a_value_and_everything_else_a_named_fault():
    port = free_port()
    nodes = POSITION | {"load_percent": ("Load", {}), "name_1": ("Name", {}), "a_1": ("Array", {})}
    nodes |= {"y_m": ("Nowhere", {})}
    async with serving(port) as variables, running(settings(port, nodes).open("cnc"), lambda: 42.5) as cnc:
        reading = await cnc.until(lambda r: "x_m" not in r.faults)
        assert reading.time_s == 42.5
        assert reading.values["x_m"] == pytest.approx(0.2235)
        assert reading.values["load_percent"] == 40.0
        others = {"name_1": "wrong_type", "a_1": "wrong_type", "y_m": "bad_node_id_unknown"}
        assert reading.faults == others
        assert math.isnan(reading.values["name_1"])
        assert math.isnan(reading.values["y_m"])
        sentence = "channel y_m: the server has no node ns=2;s=Axis.X.Nowhere; fix its node"
        assert cnc.driver.status.last_error == sentence

        for code, fault in STATUSES.items():
            value = ua.DataValue(ua.Variant(99.0), StatusCode=ua.StatusCode(ua.UInt32(code)))
            await variables["Position"].write_value(value)
            reading = await cnc.until(lambda r, fault=fault: r.faults.get("x_m") == fault)
            assert math.isnan(reading.values["x_m"])
            assert reading.values["load_percent"] == 40.0
        await variables["Position"].write_value(ua.DataValue(ua.Variant(math.inf)))
        await cnc.until(lambda r: r.faults.get("x_m") == "not_finite")
        await variables["Position"].write_value(ua.DataValue(ua.Variant(7.0)))
        await cnc.good("x_m")
        assert 99.0e-3 + 0.1 not in [r.values["x_m"] for r in cnc.readings]


async def test_a_server_that_returns_is_reconnected_within_a_second_with_faults_meanwhile():
    port = free_port()
    async with running(settings(port, POSITION | {"a_1": ("Array", {})}).open("cnc")) as cnc:
        assert await cnc.fault("x_m") == "disconnected"
        for times in range(2):
            async with serving(port):
                await cnc.good("x_m", timeout_s=1.0)  # from when it listens
                assert cnc.driver.status.connected
                assert cnc.driver.status.reconnects == times
                sentence = "channel a_1: ns=2;s=Axis.X.Array holds list, not a number; name another node"
                assert cnc.driver.status.last_error == sentence
            await cnc.fault("x_m")
            assert all("x_m" in r.faults for r in await cnc.more(10))
            assert not cnc.driver.status.connected


async def test_a_server_that_hangs_or_talks_nonsense_is_a_fault_each_period():
    held = []

    async def hang(reader, writer):
        held.append(writer)
        if len(held) % 2:
            writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        await reader.read()
        writer.close()

    server = await asyncio.start_server(hang, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        async with running(settings(port, POSITION, timeout_s=0.2).open("cnc")) as cnc:
            readings = await cnc.more(20)
    finally:
        server.close()
    assert all(r.faults == {"x_m": "disconnected"} for r in readings)
    assert cnc.driver.status.errors > 1
    assert len(held) < 20  # not hammered


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Certificates of a control, of this driver, and of a stranger."""
    made = tmp_path_factory.mktemp("keys")
    for name in ("control", "driver", "stranger"):
        application(made, name)
    secret(made / "word", "right\n")
    secret(made / "wrong", "wrong\n")
    return made


class _Anna:
    """Lets in one user by her password."""

    def get_user(self, _iserver, username=None, password=None, certificate=None):
        known = (username, password) == ("anna", "right") and certificate
        return User(UserRole.User, "anna") if known else None


@asynccontextmanager
async def strict(folder, port):
    """A control that encrypts, knows one user, and trusts one certificate, right in every field."""
    server = Server(user_manager=_Anna())
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/control")
    await server.set_application_uri("urn:control")
    server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
    server.set_identity_tokens([ua.UserNameIdentityToken])
    await server.load_certificate(folder / "control.pem")
    await server.load_private_key(folder / "control.key", format="pem")
    every_field = CertificateValidator(
        CertificateValidatorOptions.EXT_VALIDATION | CertificateValidatorOptions.PEER_CLIENT
    )
    trusted = await load_certificate(folder / "driver.pem")

    async def judge(certificate, who):
        await every_field(certificate, who)
        if certificate != trusted:
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)

    server.iserver.certificate_validator = judge
    node = ua.NodeId("Axis.X.Position", 2)
    await server.register_namespace("urn:test")
    await server.nodes.objects.add_variable(node, "2:Position", 123.5)
    await server.start()
    try:
        yield
    finally:
        await server.stop()


def known(folder, **more):
    """The driver's settings for that control, with its own identity."""
    files = {
        "certificate": "driver.pem", "private_key": "driver.key", "server_certificate": "control.pem",
        "password_file": "word",
    }  # fmt: skip
    return {key: folder / file for key, file in files.items()} | {"user": "anna", "timeout_s": 5.0} | more


async def test_a_control_that_requires_login_and_certificate_is_read_and_any_mistake_reported(folder):
    port = free_port()
    stranger = folder / "stranger.pem"
    wrong = {
        "refuses the user anna": {"password_file": folder / "wrong"},
        "refuses the user ben": {"user": "ben"},
        "does not trust": {"certificate": stranger, "private_key": folder / "stranger.key"},
        "check server_certificate": {"server_certificate": stranger, "timeout_s": 1.0},
        "accepts Aes256Sha256RsaPss": {"policy": "Aes256Sha256RsaPss", "timeout_s": 1.0},
        "requires a user name": {"user": None, "password_file": None},
        "requires encryption": dict.fromkeys(known(folder)) | {"timeout_s": 1.0},
    }
    async with strict(folder, port):
        for change in ({}, {"private_key": _der(folder)}):
            async with running(settings(port, POSITION, **known(folder, **change)).open("cnc")) as cnc:
                assert await cnc.good("x_m") == pytest.approx(0.2235)
        for sentence, change in wrong.items():
            async with running(settings(port, POSITION, **known(folder, **change)).open("cnc")) as cnc:
                await eventually(lambda said=sentence, cnc=cnc: said in (cnc.driver.status.last_error or ""))
                assert all("x_m" in r.faults for r in cnc.readings)


def _der(folder):
    """The driver's key in the other format."""
    command = (
        "openssl",
        "pkcs8",
        "-topk8",
        "-nocrypt",
        "-in",
        "driver.key",
        "-outform",
        "der",
        "-out",
        "key.der",
    )
    subprocess.run(command, cwd=folder, check=True)
    return folder / "key.der"


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        (("rsa:2048", "-passout", "pass:word"), "without a passphrase"),
        (("ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"), "not of RSA"),
        (None, "is not the key of"),
    ],
)
async def test_a_key_that_cannot_be_used_is_a_fault_that_says_so(folder, kind, sentence):
    odd = {"private_key": folder / "stranger.key"}
    if kind is not None:
        command = ("openssl", "req", "-x509", "-newkey", *kind, "-subj", "/CN=odd")
        command += ("-keyout", "odd.key", "-out", "odd.pem")
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        odd = {"certificate": folder / "odd.pem", "private_key": folder / "odd.key"}
    async with running(settings(free_port(), POSITION, **known(folder, **odd)).open("cnc")) as cnc:
        await eventually(lambda: sentence in (cnc.driver.status.last_error or ""))
        assert await cnc.fault("x_m") == "disconnected"


def test_files_that_are_not_there_are_named(tmp_path):
    files = {k: tmp_path / k for k in ("certificate", "private_key", "server_certificate")}
    channels = {"x_m": {"node": "i=1"}}
    table = OpcUaSettings(kind="opcua", url="opc.tcp://h", channels=channels, **files)
    assert len(table.file_problems("cnc")) == 3
