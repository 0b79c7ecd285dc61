"""The OPC UA server beneath the variables: access, limits for clients, and which nodes exist.

asyncua 2.1 resumes a session for anyone who names its token, which is a small number. A second connection
would read as the first one's user, without a password or encryption. Here no session is resumed. A server
with a certificate answers unencrypted requests for its endpoints only, because clients make them before they
encrypt. Nobody can log in that way, whatever the password.

asyncua also buffers data before it checks a message's length, and keeps unread answers without limit. A
client without a session may send requests without end. asyncua has no settings for these three, so
`_Connection` stands between its protocol and the transport. `opcua_limits` has the bounds of sessions.

Namespace 0 (part 5 of the standard) has 6,000 nodes, which take 50 MB. Only the nodes in use are created: the
server's own object, the base types and the data types, without the descriptions of their encodings.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import structlog
from asyncua import server as package
from asyncua import ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.address_space import NodeManagementService
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.server import Server
from asyncua.server.user_managers import UserManager
from asyncua.ua.object_ids import ObjectIds
from asyncua.ua.status_codes import StatusCodes
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey

from observer.config.outlets import Opcua
from observer.errors import ConfigError
from observer.files.regular import read_named, read_users
from observer.outlets.opcua_limits import MOST_SESSIONS, LimitedSession, announce_limits, limit
from observer.outlets.users import Users

_LEAST_BITS = 2048  # of a key, by every policy below
_PKCS1 = "http://www.w3.org/2001/04/xmlenc#rsa-1_5"
_ENCRYPTED = [
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
]
log = structlog.get_logger()


async def guarded(settings: Opcua) -> Server:
    """A server with the access of the settings; raises `ConfigError` if a file cannot be used."""
    users, name = None, None
    if settings.users_file is not None:
        users = Users(read_users(settings.users_file, "opcua.users_file"))
    server = Server(iserver=_Guarded(_Readers(users, encrypted=settings.certificate is not None)))
    if settings.certificate is not None and settings.key is not None:
        name = await _identify(server, settings.certificate, settings.key)
        server.set_security_policy(_ENCRYPTED)
        server.set_identity_tokens([ua.AnonymousIdentityToken if users is None else ua.UserNameIdentityToken])
    else:
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    bound(server)
    await server.init()
    await announce_limits(server)
    server.allow_remote_admin(False)  # else whoever says "admin", without a password, may write
    if name is not None:
        await server.set_application_uri(name)
    return server


async def _identify(server: Server, certificate: Path, key: Path) -> str | None:
    """Give the server its certificate and key; returns the application's name in the certificate."""
    shown, secret = read_named(certificate, "opcua.certificate"), read_named(key, "opcua.key", secret=True)
    try:
        await server.load_certificate(shown, _format(shown))
        await server.load_private_key(secret, None, _format(secret))
    except (ValueError, TypeError) as error:  # TypeError: the key has a passphrase
        raise ConfigError(
            f"opcua.certificate: {certificate} and {key} are not a certificate and a key without a "
            "passphrase "
            f"({error}); name files in PEM or DER"
        ) from None
    ours, private = server.iserver.certificate, server.iserver.private_key
    if not isinstance(private, RSAPrivateKey) or private.key_size < _LEAST_BITS:
        raise ConfigError(
            f"opcua.key: OPC UA requires RSA with {_LEAST_BITS} bits or more; create {key} again"
        )
    if private.public_key() != ours.public_key():
        raise ConfigError(f"opcua.key: {key} is not the key of {certificate}; name the two that go together")
    return _name_in(ours)


def _format(data: bytes) -> str:
    return "pem" if b"-----BEGIN" in data else "der"


def _name_in(certificate: x509.Certificate) -> str | None:
    """Return the application's URI in its certificate, which clients check (part 6, 6.2.2)."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (x509.ExtensionNotFound, ValueError):
        return None
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), None)


class _Readers(UserManager):
    """Admits readers, and nobody with write access; `asking` is the address of the client that logs in."""

    def __init__(self, users: Users | None, *, encrypted: bool) -> None:
        self._users, self._encrypted = users, encrypted
        self.asking = ""

    def get_user(
        self,
        _iserver: InternalServer,
        username: str | None = None,
        password: str | None = None,
        certificate: bytes | None = None,
    ) -> User | None:
        """The user, None if unknown; a client that does not encrypt has no `certificate`."""
        if self._encrypted and not certificate:
            return None
        if self._users is None:
            return User(role=UserRole.User)
        if username is None or self._users.is_throttled(self.asking):
            return None
        if not self._users.is_right(username, password or "", self.asking):
            log.warning("OPC UA: wrong name or password", user=username[:64], address=self.asking)
            return None
        return User(role=UserRole.User, name=username)


_NOBODY = User(role=UserRole.Anonymous)


class _Guarded(InternalServer):
    """The services behind the transport, without those that would let somebody in by another way."""

    def __init__(self, readers: _Readers) -> None:
        super().__init__(user_manager=readers)
        self._readers = readers

    async def load_standard_address_space(self, _shelf_file: Path | None = None) -> None:
        """Create the standard OPC UA nodes that are used here."""
        await asyncio.to_thread(fill, self.node_mgt_service)

    def lookup_external_session(self, _auth_token: ua.NodeId) -> InternalSession | None:
        """None: a session belongs to the connection that made it."""
        return None

    def create_session(self, name: Any, user: User = _NOBODY, external: bool = False) -> InternalSession:
        """A session with limits, one for a connection, which is `name`; raises `ServiceError`."""
        if not external:
            return super().create_session(name, user, external)
        sessions = self._external_sessions.values()
        if len(sessions) >= MOST_SESSIONS or any(session.name == name for session in sessions):
            raise ServiceError(StatusCodes.BadTooManySessions)
        return LimitedSession(self, self.aspace, self.subscription_service, name, user, external)

    def register_server(self, _server: Any, _conf: Any = None) -> None:
        """Refuse: this server lists no other servers."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)

    def decrypt_user_token(self, isession: Any, token: ua.UserNameIdentityToken) -> tuple[str, str]:
        """Name and password; padding of PKCS #1 is refused, because its errors reveal the key."""
        if token.EncryptionAlgorithm == _PKCS1:
            raise ServiceError(StatusCodes.BadIdentityTokenRejected)
        self._readers.asking = isession.name[0]
        return super().decrypt_user_token(isession, token)


_CHUNK = 65535
_MOST_BYTES = 128 * 1024
"""Largest message: it is decoded before its nodes are counted. Chunks have 8 kB or more (part 6, 6.7.2)."""
_MOST_CONNECTIONS = 100
_ACTIVE_WITHIN_S = 10.0
_MOST_WAITING = 8  # connections of one address without a session
_MOST_EARLY_MESSAGES = 32  # messages before a session is active; a client takes some five
_MOST_UNREAD = 4_000_000  # bytes of answers that a client has not taken
_PIECE = 8192  # each message is kept with the rest of what it came with
_HEADER = 8  # bytes: type, kind of chunk, and size of the whole chunk


def bound(server: Server) -> None:
    """Set the bounds of a server that has not been started."""
    server.limits = TransportLimits(_CHUNK, _CHUNK, _MOST_BYTES // 8192, _MOST_BYTES)
    limit(server.iserver)
    server.iserver.max_connections = _MOST_CONNECTIONS
    server.iserver.max_pending_activation_seconds = _ACTIVE_WITHIN_S
    server.iserver.asyncio_transports = _Transports()


class _Transports(list[asyncio.Transport]):
    """The open connections of a server, each of them bounded from its beginning."""

    def append(self, transport: asyncio.Transport) -> None:
        """Take a connection; where an address has many without a session, the oldest of them make room."""
        connection = _Connection(transport)
        ours = [other for other in map(_connection_of, self) if other.address == connection.address]
        waiting = [other for other in ours if not other.is_active]
        for other in waiting[: max(0, len(waiting) - _MOST_WAITING + 1)]:
            other.transport.abort()
        transport.set_protocol(connection)
        super().append(transport)


def _connection_of(transport: asyncio.Transport) -> _Connection:
    connection = transport.get_protocol()
    assert isinstance(connection, _Connection)
    return connection


class _Connection(asyncio.Protocol):
    """Stands before asyncua's protocol, and ends the connection if its client takes too much."""

    def __init__(self, transport: asyncio.Transport) -> None:
        self.transport = transport
        self.address = transport.get_extra_info("peername")[0]
        self._served: Any = transport.get_protocol()
        self._header = b""
        self._missing_bytes = 0
        self._early_messages = 0
        transport.set_write_buffer_limits(high=_MOST_UNREAD)

    @property
    def is_active(self) -> bool:
        """Whether its client has logged in."""
        session = self._served.processor.session
        return session is not None and session.is_activated()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the session, too: nobody can take it up again."""
        self._served.connection_lost(exc)
        if (session := self._served.processor.session) is not None:
            self._served.closing_tasks.append(asyncio.create_task(session.close_session(True)))

    def pause_writing(self) -> None:
        """End a connection whose answers are not taken."""
        self.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Pass on what is received, unless its header announces too much."""
        if not self._is_within_bounds(data):
            self.transport.abort()
        for start in range(0, len(data), _PIECE):
            if self.transport.is_closing():
                return
            self._served.data_received(data[start : start + _PIECE])

    def _is_within_bounds(self, data: bytes) -> bool:
        """Whether all chunks that begin in the data are short enough, and few before the login."""
        position = 0
        while position < len(data):
            if self._missing_bytes:
                count = min(self._missing_bytes, len(data) - position)
                self._missing_bytes -= count
            else:
                count = min(_HEADER - len(self._header), len(data) - position)
                self._header += data[position : position + count]
                if len(self._header) == _HEADER:
                    self._missing_bytes = int.from_bytes(self._header[4:], "little") - _HEADER
                    self._header = b""
                    self._early_messages += not self.is_active
                    if not 0 <= self._missing_bytes <= _CHUNK or self._early_messages > _MOST_EARLY_MESSAGES:
                        return False
            position += count
        return True


_SPACE = "standard_address_space"
_IDS = ObjectIds
_UNUSED = {
    _IDS.BaseEventType, _IDS.OpcUa_XmlSchema, _IDS.OpcUa_BinarySchema, _IDS.ServerConfiguration,
    _IDS.Server_ServerCapabilities_RoleSet, _IDS.PublishSubscribe,
}  # fmt: skip
_USED_KINDS_OF_OBJECTS = {
    _IDS.FolderType, _IDS.ServerType, _IDS.ServerCapabilitiesType, _IDS.ServerDiagnosticsType,
    _IDS.SessionsDiagnosticsSummaryType, _IDS.SessionDiagnosticsObjectType, _IDS.VendorServerInfoType,
    _IDS.ServerRedundancyType, _IDS.OperationLimitsType, _IDS.DataTypeSystemType, _IDS.DataTypeEncodingType,
    _IDS.ModellingRuleType, _IDS.NamespaceMetadataType, _IDS.NamespacesType,
}  # fmt: skip


def fill(service: NodeManagementService) -> None:
    """Create the nodes, and release the code that describes them all, 16 MB."""
    from asyncua.server.standard_address_space.standard_address_space import (  # noqa: PLC0415
        fill_address_space,
    )

    fill_address_space(_Chosen(service))  # type: ignore[no-untyped-call]
    for name in [name for name in sys.modules if name.startswith(f"{package.__name__}.{_SPACE}")]:
        del sys.modules[name]
    delattr(package, _SPACE)


class _Chosen:
    """Adds the nodes that are used, and the references between them."""

    def __init__(self, service: NodeManagementService) -> None:
        self._service = service
        self._left_out: set[ua.NodeId] = set()

    def try_add_nodes(
        self, items: Iterable[ua.AddNodesItem], *, check: bool = True
    ) -> Iterator[ua.AddNodesItem]:
        """Add nodes; yields those whose parent does not exist yet."""
        return self._service.try_add_nodes([item for item in items if self._is_used(item)], check=check)

    def try_add_references(self, items: Iterable[ua.AddReferencesItem]) -> Iterator[ua.AddReferencesItem]:
        """Add references; yields those whose source does not exist yet."""
        return self._service.try_add_references(
            [item for item in items if not {item.SourceNodeId, item.TargetNodeId} & self._left_out]
        )

    def _is_used(self, item: ua.AddNodesItem) -> bool:
        """Whether a node is wanted; what is below one that is not, or is of its type, is not either."""
        node, parent = item.RequestedNewNodeId, item.ParentNodeId
        used = not (
            node.Identifier in _UNUSED
            or item.ReferenceTypeId.Identifier == _IDS.HasEncoding
            or {parent, item.TypeDefinition} & self._left_out
            or (
                parent.Identifier == _IDS.BaseObjectType
                and item.NodeClass == ua.NodeClass.ObjectType
                and node.Identifier not in _USED_KINDS_OF_OBJECTS
            )
        )
        if not used:
            self._left_out.add(node)
        return used
