"""Who is let in to the OPC UA server: certificate, names and passwords, and what asyncua would leave open.

asyncua 2.1 takes up a session again for whoever names its token, which is a small number: a second connection
reads as the first one's user, without a password, and unencrypted where the server asks for encryption. Here
no session is taken up again. A server with a certificate still answers unencrypted questions for its
endpoints, as clients put them before they encrypt, but nobody logs in that way, whatever the password.
"""

from __future__ import annotations

import asyncio
import stat
from pathlib import Path
from typing import Any

import structlog
from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.server import Server
from asyncua.server.user_managers import UserManager
from asyncua.ua.status_codes import StatusCodes
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey

from observer.errors import ConfigError
from observer.gateway.opcua_bounds import bound
from observer.gateway.opcua_space import fill
from observer.gateway.users import Users, read_users
from observer.tables.gateway import Opcua

_LEAST_BITS = 2048  # of a key, by every policy below
_PKCS1 = "http://www.w3.org/2001/04/xmlenc#rsa-1_5"
_ENCRYPTED = [
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
]
log = structlog.get_logger()


async def guarded(settings: Opcua) -> Server:
    """A server that lets in whom the settings name; raises `ConfigError` where a file cannot be used."""
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
    server.allow_remote_admin(False)  # else whoever says "admin", without a password, may write
    if name is not None:
        await server.set_application_uri(name)
    return server


async def _identify(server: Server, certificate: Path, key: Path) -> str | None:
    """Give the server its certificate and key; returns the application's name in the certificate."""
    shown, secret = _read("certificate", certificate), _read("key", key, secret=True)
    try:
        await server.load_certificate(shown, _format(shown))
        await server.load_private_key(secret, None, _format(secret))
    except (ValueError, TypeError) as error:  # TypeError: the key has a passphrase
        raise ConfigError(
            f"opcua.certificate: {certificate} and {key} are no certificate and key without a passphrase "
            f"({error}); name files in PEM or DER"
        ) from None
    ours, private = server.iserver.certificate, server.iserver.private_key
    if not isinstance(private, RSAPrivateKey) or private.key_size < _LEAST_BITS:
        raise ConfigError(f"opcua.key: OPC UA asks for RSA with {_LEAST_BITS} bits or more; make {key} anew")
    if private.public_key() != ours.public_key():
        raise ConfigError(f"opcua.key: {key} is not the key of {certificate}; name the two that go together")
    return _name_in(ours)


def _read(key: str, path: Path, *, secret: bool = False) -> bytes:
    try:
        mode, data = path.stat().st_mode, path.read_bytes()
    except OSError as error:
        raise ConfigError(
            f"opcua.{key}: {path} cannot be read ({error.strerror}); mend or rename it"
        ) from None
    if secret and stat.S_IMODE(mode) & 0o077:
        raise ConfigError(f"opcua.{key}: others on this computer can read {path}; run chmod 600 {path}")
    return data


def _format(data: bytes) -> str:
    return "pem" if b"-----BEGIN" in data else "der"


def _name_in(certificate: x509.Certificate) -> str | None:
    """The name of an application in its certificate, by which clients know whose it is (part 6, 6.2.2)."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (x509.ExtensionNotFound, ValueError):
        return None
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), None)


class _Readers(UserManager):
    """Lets in those who may read, nobody who may write; `asking` is the address of whoever logs in."""

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
        """Whoever that is, None where it is nobody; who does not encrypt has no `certificate`."""
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


class _Guarded(InternalServer):
    """The services below the wire, without those that would let somebody in by another way."""

    def __init__(self, readers: _Readers) -> None:
        super().__init__(user_manager=readers)
        self._readers = readers

    async def load_standard_address_space(self, _shelf_file: Path | None = None) -> None:
        """Make of what OPC UA itself defines what is used here."""
        await asyncio.to_thread(fill, self.node_mgt_service)

    def lookup_external_session(self, _auth_token: ua.NodeId) -> InternalSession | None:
        """None: a session belongs to the connection that made it."""
        return None

    def register_external_session(self, session: InternalSession) -> None:
        """Keep no list of them, which would keep each that was never taken up."""

    def register_server(self, _server: Any, _conf: Any = None) -> None:
        """Refuse: this is no directory of others."""
        raise ServiceError(StatusCodes.BadServiceUnsupported)

    def decrypt_user_token(self, isession: Any, token: ua.UserNameIdentityToken) -> tuple[str, str]:
        """Name and password; padding of PKCS #1 is refused, because its errors would tell of the key."""
        if token.EncryptionAlgorithm == _PKCS1:
            raise ServiceError(StatusCodes.BadIdentityTokenRejected)
        self._readers.asking = isession.name[0]
        return super().decrypt_user_token(isession, token)
