"""The only file that uses asyncua: one session with one OPC UA server, reads only."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
from datetime import UTC, datetime
from math import isfinite, nan
from pathlib import Path

from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto import security_policies
from asyncua.crypto.uacrypto import CertProperties, load_certificate, load_private_key
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.uaerrors import (
    BadCertificateInvalid,
    BadCertificateTimeInvalid,
    BadCertificateUntrusted,
    BadCertificateUriInvalid,
    BadCertificateUseNotAllowed,
    BadIdentityTokenInvalid,
    BadIdentityTokenRejected,
    BadSecurityChecksFailed,
    BadUserAccessDenied,
    UaError,
)
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicKey

from drivers.connecting import why_not_opened
from drivers.opcua import OpcUaSettings
from drivers.places import OpcUaChannel
from drivers.polled import LostError, PolledValue, SourceTimes
from drivers.protocol import Clock
from observer.frames import Reading

# Everything asyncua logs also comes as its exceptions, which are counted in the driver's status.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)

_GOOD_BYE_S = 0.2
_FILES, _FILES_REMEDY = (
    "certificate, private_key and server_certificate",
    "name RSA, PEM or DER, without a passphrase",
)
_USER_REJECTED = (BadUserAccessDenied, BadIdentityTokenRejected, BadIdentityTokenInvalid)
_CERTIFICATE = (
    BadCertificateUntrusted, BadCertificateUriInvalid, BadCertificateUseNotAllowed,
    BadCertificateTimeInvalid, BadCertificateInvalid, BadSecurityChecksFailed,
)  # fmt: skip
_LIMITS = {0x0500: "under_range", 0x0600: "over_range"}  # bits 8 to 11: at its low, high limit (part 4, 7.39)
_NEVER = datetime(1980, 1, 1, tzinfo=UTC)  # servers without a clock give 1601, 1970 or none


async def connect(server: OpcUaSettings, now: Clock) -> OpcUaSession:
    """Connect once, encrypted if the table names a certificate.

    Args:
        server: The server and its channels.
        now: The service's clock in s.

    Returns:
        An open session.

    Raises:
        LostError: If the server does not answer within `timeout_s`, rejects user or certificate, or a file
            cannot be used. The text names the key to correct.
    """
    client = Client(server.url, timeout=server.timeout_s, watchdog_intervall=3600.0)
    try:
        async with asyncio.timeout(server.timeout_s):
            await _secure(client, server)
            await client.connect()
    except TimeoutError:
        await _end(client)
        raise LostError(
            "disconnected", f"{server.url} does not answer: check the server and its address{_unless(server)}"
        ) from None
    except (OSError, ValueError, UaError) as error:
        await _end(client)
        if isinstance(error, OSError) and error.filename is None:
            raise LostError("disconnected", why_not_opened(error, server.url)) from None
        raise LostError("disconnected", f"{server.url}{_why_not(error, server)}") from None
    except asyncio.CancelledError:
        await _end(client)
        raise
    return OpcUaSession(client, server, now)


def _unless(server: OpcUaSettings) -> str:
    """Return other reasons for silence: servers close or ignore a connection that they cannot decrypt."""
    if server.certificate is None:
        return ""
    return f"; if it is up, check server_certificate and whether it accepts {server.policy}"


def _why_not(error: Exception, server: OpcUaSettings) -> str:
    """Return why a server rejects the connection, as the end of a sentence that begins with its address."""
    if isinstance(error, _USER_REJECTED):
        if server.user is None:
            return " requires a user name; give user and password_file"
        return f" refuses the user {server.user}; check user and password_file"
    if isinstance(error, _CERTIFICATE):
        return f" does not trust {server.certificate} ({_reason(error)}); have it trusted there"
    if server.certificate is None and "No matching endpoint" in str(error):
        return " requires encryption; give certificate, private_key and server_certificate"
    return f": {_reason(error)}"


async def _secure(client: Client, server: OpcUaSettings) -> None:
    """Give the client its certificates, key and password. Raises `OSError` or `ValueError` for an unusable
    file.
    """
    files = (server.certificate, server.private_key, server.server_certificate)
    client_file, key_file, server_file = (None if file is None else _file(file) for file in files)
    if client_file is not None and key_file is not None and server_file is not None:
        try:
            certificate = await load_certificate(client_file.path_or_content, client_file.extension)
            private = await load_private_key(key_file.path_or_content, None, key_file.extension)
            public = (await load_certificate(server_file.path_or_content, server_file.extension)).public_key()
        except (ValueError, TypeError) as error:  # TypeError: the key has a passphrase
            raise ValueError(f"{_FILES} cannot be used ({error}); {_FILES_REMEDY}") from None
        if not isinstance(private, RSAPrivateKey) or not isinstance(public, RSAPublicKey):
            raise ValueError(f"{_FILES} cannot be used (they are not of RSA); {_FILES_REMEDY}")
        if private.public_key() != certificate.public_key():
            raise ValueError(f"{server.private_key} is not the key of {server.certificate}; fix private_key")
        if name := _name_in(certificate):
            client.application_uri = name  # servers compare it with the certificate (part 4, 6.1.3)
        policy = getattr(security_policies, f"SecurityPolicy{server.policy}")
        await client.set_security(policy, client_file, key_file, server_certificate=server_file)
    if server.user is not None and server.password_file is not None:
        client.set_user(server.user)
        client.set_password(server.password_file.read_text(encoding="utf-8").strip())


def _file(path: Path) -> CertProperties:
    """Return a file with its format determined from its content.

    asyncua determines it from the name, and takes a PEM file named `x.key` for DER.
    """
    data = path.read_bytes()
    return CertProperties(data, "pem" if b"-----BEGIN" in data else "der")


def _name_in(certificate: x509.Certificate) -> str | None:
    """Return the URI of the application in a certificate; None if it has no URI."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (x509.ExtensionNotFound, ValueError):
        return None
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), None)


class OpcUaSession:
    """An open session with the server.

    Attributes:
        problem: A sentence about a channel whose node is missing or is not a number; None if the last poll
            had none such.
    """

    def __init__(self, client: Client, server: OpcUaSettings, now: Clock) -> None:
        self.problem: str | None = None
        self._client = client
        self._server = server
        self._now = now
        self._times = SourceTimes()
        self._nodes = [client.get_node(place.node) for place in server.channels.values()]

    async def ask(self) -> list[Reading]:
        """Read every node in one request; return one reading for each source time, oldest first.

        A value counts only if its status is plainly good. Other statuses give a fault of their name, such as
        `bad_sensor_failure`, or `under_range` and `over_range` at a limit.

        Raises:
            LostError: If the server does not answer within `timeout_s`, the session has ended, or the number
                of values is wrong.
        """
        url = self._server.url
        try:
            async with asyncio.timeout(self._server.timeout_s):
                values = await self._client.read_attributes(self._nodes, AttributeIds.Value)
        except TimeoutError:
            raise LostError(
                "timeout", f"{url} does not answer in time; check the server, or raise timeout_s"
            ) from None
        except (OSError, ValueError, UaError) as error:
            raise LostError("disconnected", f"{url}: {_reason(error)}") from None
        if len(values) != len(self._nodes):
            raise LostError(
                "bad_reply",
                f"{url} was asked for {len(self._nodes)} values and gave {len(values)}; restart the server",
            )
        self.problem = None
        answers = {
            channel: self._answer(channel, place, data)
            for (channel, place), data in zip(self._server.channels.items(), values, strict=True)
        }
        return self._times.readings(answers, self._now())

    async def close(self) -> None:
        """End the session; a server that is gone holds this up for 0.2 s at most."""
        await _end(self._client)

    def _answer(self, channel: str, place: OpcUaChannel, data: ua.DataValue) -> PolledValue:
        """Return the value or fault of one node, and describe a wrong node in `problem`."""
        stamp_s = _seconds(data.SourceTimestamp)
        if data.StatusCode is not None and (fault := _fault(data.StatusCode)) is not None:
            if fault.startswith("bad_node"):
                self.problem = f"channel {channel}: the server has no node {place.node}; fix its node"
            return PolledValue(fault=fault, stamp_s=stamp_s)
        number = None if data.Value is None else data.Value.Value
        if isinstance(number, bool | int | float):
            value = place.value(float(number))
            return PolledValue(value, stamp_s=stamp_s) if isfinite(value) else PolledValue(fault="not_finite")
        kind = "nothing" if number is None else type(number).__name__
        self.problem = f"channel {channel}: {place.node} holds {kind}, not a number; name another node"
        return PolledValue(fault="wrong_type", stamp_s=stamp_s)


def _fault(status: ua.StatusCode) -> str | None:
    """Return the name of a status that is not plainly good: BadSensorFailure becomes bad_sensor_failure."""
    if status.value & 0xFFFF0000 == 0:
        return _LIMITS.get(status.value & 0x0F00)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", status.name).lower()[:64]


def _seconds(stamp: datetime | None) -> float:
    """Return a time in s since 1970; NaN for a missing one or one of a clock that was never set."""
    if stamp is None:
        return nan
    stamp = stamp if stamp.tzinfo is not None else stamp.replace(tzinfo=UTC)
    return stamp.timestamp() if stamp > _NEVER else nan


async def _end(client: Client) -> None:
    """Close the session with a server that may be gone."""
    with contextlib.suppress(Exception):  # whatever it says, the socket is closed next
        await asyncio.wait_for(client.disconnect(), _GOOD_BYE_S)
    with contextlib.suppress(Exception):
        client.disconnect_socket()


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__
