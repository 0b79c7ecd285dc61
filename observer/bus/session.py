"""Zenoh sessions: endpoints, limits, credentials, access control, and closing in time."""

from __future__ import annotations

import errno
import json
import re
import socket
import ssl
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import zenoh

from observer.config.publishing import Access, Client, Login, Publish, Tls
from observer.errors import ConfigError
from observer.files.regular import read_named, read_password, read_users

RETRY_MS = 250  # Zenoh's own pauses grow to 4 s; reconnect within a second of a router's return
LEASE_MS = 2000
MOST_BYTES = 65_536
"""The largest message that a service accepts: genuine ones are queries of a few words."""
_CLIENT_MOST_BYTES = 16_777_216  # what a service answers may be a long history
LOCAL = "unixsock-stream"
"""The kind of endpoint that is a socket in a folder, whose permissions say who may connect."""
_CONNECT_MS = 1000
_SESSIONS = 128
_STALLED_US = 1_000_000  # a client that does not take its answer is cut off, so that the others get theirs


def session_config(
    mode: str,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    most_bytes: int = _CLIENT_MOST_BYTES,
    extra: Mapping[str, Any] = MappingProxyType({}),
) -> zenoh.Config:
    """Return a Zenoh configuration that talks to the named endpoints and to nobody else.

    Multicast and gossip are off. A lost link is opened again every 250 ms.

    Args:
        mode: `client`, `peer` or `router`.
        connect: Endpoints to connect to; a client fails if none answers within a second.
        listen: Endpoints to listen on.
        most_bytes: A larger message is thrown away as it comes in.
        extra: Other keys of Zenoh's, which replace those chosen here.
    """
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "connect/endpoints": list(connect),
        "connect/timeout_ms": _CONNECT_MS if mode == "client" else -1,
        "connect/exit_on_failure": mode == "client",
        "connect/retry": {
            "period_init_ms": RETRY_MS,
            "period_max_ms": RETRY_MS,
            "period_increase_factor": 1,
        },
        "listen/endpoints": list(listen),
        "scouting/multicast/enabled": False,
        "scouting/gossip/autoconnect": {"router": [], "peer": []},
        "open/return_conditions/connect_scouted": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": _STALLED_US,
        "transport/link/rx/max_message_size": most_bytes,
        "transport/unicast/max_sessions": _SESSIONS,
        "transport/shared_memory/enabled": False,
        **extra,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def service_config(settings: Publish) -> zenoh.Config:
    """Return the session of a service, with its limits, credentials and roles.

    Raises:
        ConfigError: If a file of keys or passwords cannot be used; it names the key of the configuration.
    """
    extra = _tls(settings.tls or Tls(), "publish.tls", listens=bool(settings.listen))
    extra |= _login(settings.login or Login(), "publish.login")
    if settings.access is not None:
        extra["access_control"] = access_control(settings.access)
    return session_config(settings.mode, settings.connect, settings.listens, MOST_BYTES, extra)


def ear_config(settings: Publish) -> zenoh.Config | None:
    """Return a second session for a peer, which hears what its router does not pass to peers.

    Returns:
        A client of the same endpoints; None unless the service is a peer that connects somewhere.

    Raises:
        ConfigError: If a file of keys or passwords cannot be used.
    """
    if settings.mode != "peer" or not settings.connect:
        return None
    client_role = {"mode": "client", "listen": (), "access": None}
    return service_config(settings.model_copy(update=client_role))


def client_config(connect: tuple[str, ...], client: Client | None = None) -> zenoh.Config:
    """Return the session of a command.

    Args:
        connect: Endpoints, of which one has to answer.
        client: Certificates and login; None without.

    Raises:
        ConfigError: If a file of keys or passwords cannot be used; it names the key of the client's table.
    """
    shown = client or Client()
    extra = _tls(shown.tls or Tls(), "tls", listens=False) | _login(shown.login or Login(), "login")
    return session_config("client", connect, (), extra=extra)


def _tls(tls: Tls, place: str, *, listens: bool) -> dict[str, Any]:
    """Zenoh's keys for certificates.

    Zenoh has one switch for showing a certificate and for requiring the other's; a client that only
    connects shows its own.
    """
    settings: dict[str, Any] = {}
    context = ssl.create_default_context()
    if tls.ca is not None:
        settings["root_ca_certificate"] = ca = _checked(tls.ca, f"{place}.ca")
        _try(lambda: context.load_verify_locations(ca), f"{place}.ca")
    if tls.certificate is not None and tls.key is not None:
        certificate = _checked(tls.certificate, f"{place}.certificate")
        key = _checked(tls.key, f"{place}.key", secret=True)
        _try(lambda: context.load_cert_chain(certificate, key, password=""), f"{place}.certificate")
        settings |= {"listen_certificate": certificate, "listen_private_key": key}
        settings |= {"connect_certificate": certificate, "connect_private_key": key}
    if not settings:
        return {}
    settings["enable_mtls"] = tls.client_certificates or (tls.certificate is not None and not listens)
    return {"transport/link/tls": settings}


def _try(load: Callable[[], object], place: str) -> None:
    try:
        load()
    except (ssl.SSLError, OSError) as error:
        raise ConfigError(
            f"{place}: no usable PEM file ({error}); give a certificate, and its key without a password"
        ) from None


def _login(login: Login, place: str) -> dict[str, Any]:
    """Zenoh's keys for names and passwords; Zenoh itself would ignore a wrong line."""
    settings: dict[str, Any] = {}
    if login.users_file is not None:
        read_users(login.users_file, f"{place}.users_file")
        settings["dictionary_file"] = str(login.users_file.absolute())
    if login.user is not None and login.password_file is not None:
        password = read_password(login.password_file, f"{place}.password_file")
        settings |= {"user": login.user, "password": password}
    return {"transport/auth/usrpwd": settings} if settings else {}


def _checked(file: Path, place: str, *, secret: bool = False) -> str:
    """The path of a file that can be read."""
    read_named(file, place, secret=secret)
    return str(file.absolute())


# Roles: who may do what, in the words of Zenoh's access control, which denies all else. It judges a key
# expression as asked, by inclusion: `ballscrew/**` lies within none of the patterns that may be queried, so
# no wildcard reaches the commands.
_EVERYTHING = "ballscrew/**"
_ANSWERS = ("ballscrew/*/*/*", "ballscrew/*/*/truth/*")
_COMMANDS = "ballscrew/*/*/command/*"
_ROLES = {
    "viewer": ("receive", "be sent", "ask"),
    "operator": ("receive", "be sent", "ask", "command"),
    "service": ("receive", "be sent", "ask", "command", "serve", "be asked"),
}


def _rule(name: str, flow: str, messages: tuple[str, ...], *keys: str) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


_RULES = (
    _rule(
        "receive", "ingress",
        ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"), _EVERYTHING,
    ),
    _rule(
        "be sent", "egress",
        ("put", "delete", "reply", "liveliness_token", "declare_queryable"), _EVERYTHING,
    ),
    _rule("ask", "ingress", ("query",), *_ANSWERS),
    _rule("command", "ingress", ("query",), _COMMANDS),
    _rule(
        "serve", "ingress",
        ("put", "delete", "reply", "liveliness_token", "declare_queryable"), _EVERYTHING,
    ),
    _rule(
        "be asked", "egress",
        ("query", "declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"), _EVERYTHING,
    ),
)  # fmt: skip


def access_control(access: Access) -> dict[str, Any]:
    """Return Zenoh's `access_control` for a table of roles.

    Whoever is not in the table may do nothing. Viewers receive and query, operators also send commands, and
    only services publish.
    """
    named = {role: subjects for role in _ROLES if (subjects := getattr(access, role))}
    used = {rule for role in named for rule in _ROLES[role]}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rule in _RULES if rule["id"] in used],
        "subjects": [
            {"id": f"{role} {subject}", **_subject(subject)}
            for role, subjects in named.items()
            for subject in subjects
        ],
        "policies": [
            {"rules": _ROLES[role], "subjects": [f"{role} {subject}" for subject in subjects]}
            for role, subjects in named.items()
        ],
    }


def _subject(subject: str) -> dict[str, list[str]]:
    kind, name = subject.split(":", 1)
    return {"usernames" if kind == "user" else "cert_common_names": [name]}


class Closable(Protocol):
    """A session, or several in one."""

    def close(self) -> None:
        """End it."""


def close_within(session: Closable, timeout_s: float) -> bool:
    """Close a session, giving up when a frozen peer does not answer; returns whether it closed.

    Closing goes on in a daemon thread when the time is over.

    Args:
        session: What to close; it must not be used afterwards.
        timeout_s: The longest wait, in s.
    """
    thread = threading.Thread(target=close, args=(session,), name="zenoh-close", daemon=True)
    thread.start()
    thread.join(timeout_s)
    return not thread.is_alive()


def close(session: Closable) -> None:
    """Close a session, however long it takes. Errors of Zenoh are ignored, because the peer may be gone."""
    try:
        session.close()
    except zenoh.ZError:
        return  # a frozen router does not confirm; nobody is left to notify


def short(error: Exception) -> str:
    """The first sentence of an error, without locations in Zenoh's source.

    Zenoh appends the place in its source, which does not help a user.
    """
    return str(error).split(" at /", 1)[0].splitlines()[0].rstrip(".")


_TCP = re.compile(r"tcp/\[?(?P<host>[^\]/?#]+?)\]?:(?P<port>\d+)([?#].*)?")


def refuse_taken(endpoints: Iterable[str], place: str) -> None:
    """Check that no other program listens on TCP endpoints.

    Other kinds of endpoints, and addresses that do not exist yet, are accepted.

    Args:
        endpoints: Zenoh endpoints.
        place: The key of the configuration, for the message.

    Raises:
        ConfigError: If an endpoint is in use; it names the place and the endpoint.
    """
    for endpoint in endpoints:
        if (tcp := _TCP.fullmatch(endpoint)) and _is_taken(tcp["host"], int(tcp["port"])):
            raise ConfigError(
                f"{place}: another program listens on {endpoint}; stop it or choose another port"
            )


def _is_taken(host: str, port: int) -> bool:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, OverflowError) as error:  # an address that does not exist yet is waited for
        return isinstance(error, OSError) and error.errno == errno.EADDRINUSE
    return False
