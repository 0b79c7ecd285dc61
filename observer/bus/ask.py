"""The client's side: one query to a running service, and a usable reply in every case."""

from __future__ import annotations

import contextlib
import getpass
import json
import re
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import zenoh

from observer.bus.exchange import plain_name
from observer.bus.session import client_config, close_within
from observer.config.publishing import Client

_ESTIMATING = {"starting", "good", "degraded"}
_HASH = re.compile(r"[0-9a-f]{1,64}")
_AGAIN_S = 0.2
_LONGEST = 300


@dataclass(frozen=True, slots=True)
class Reply:
    """A JSON object, or the reason for its absence; and its machine and axis.

    Attributes:
        document: The answer; None if there is none.
        problem: Then a sentence with the reason and the remedy; else empty.
        source: Machine and axis of the service that answered.
    """

    document: dict[str, Any] | None
    problem: str = ""
    source: tuple[str, str] = ("", "")


class Address(NamedTuple):
    """Where a service is asked.

    Attributes:
        connect: A Zenoh endpoint, such as `tcp/127.0.0.1:7447`.
        machine: The machine's name; `*` where one service answers.
        axis: The axis' name; `*` where one service answers.
        client: Certificates and login of this client; None without.
    """

    connect: str
    machine: str
    axis: str
    client: Client | None = None


def ask_health(address: Address, timeout_s: float) -> Reply:
    """Return the health of a running service, or the reason why it did not answer.

    Args:
        address: The service.
        timeout_s: The longest wait, in s.

    Raises:
        ConfigError: If a file of the client's keys or passwords cannot be used.
    """
    return ask(address, "health", timeout_s)


def gives_estimates(health: Mapping[str, Any]) -> bool:
    """Whether a service with this health report makes estimates from measurements.

    A `state` of `starting` has two causes: a heat is not known yet, or nothing has been estimated at all. The
    `quality` of the estimates decides between them; an older service does not send it.

    Args:
        health: The document of the key `health`; words that are missing or unknown count as no estimates.
    """
    state, quality = health.get("state"), health.get("quality", "good")
    return all(isinstance(word, str) and word in _ESTIMATING for word in (state, quality))


def command(
    kind: str,
    address: Address,
    timeout_s: float,
    digest: str | None = None,
    parameters: Mapping[str, str] | None = None,
    by: str | None = None,
) -> Reply:
    """Send a command to a running service; `done` in the answer says whether it was carried out.

    The command names the configuration it is meant for. With `*` in the address it is sent only if exactly
    one service answers.

    Args:
        kind: The command, such as `arm`.
        address: The service.
        timeout_s: The longest wait for the answer, in s.
        digest: The hash of the configuration; None takes the one in force now.
        parameters: Further ones, such as the `id` of the alarm that is acknowledged.
        by: Who commands; None is this user at this computer.

    Returns:
        The answer, or the reason for its absence. Without an answer the command may still have been carried
        out.

    Raises:
        ConfigError: If a file of the client's keys or passwords cannot be used.
    """
    until_s = time.monotonic() + timeout_s
    if digest is None or "*" in address[1:3]:
        config = _only_config(address, timeout_s)
        if config.document is None:
            return config
        machine, axis = config.source
        address = address._replace(machine=machine, axis=axis)
        digest = digest or config.document.get("hash")
    if not isinstance(digest, str) or not _HASH.fullmatch(digest):
        name = f"{address.machine}/{address.axis}"
        return Reply(
            None, f"{name} gives no hash of its configuration, so nothing was sent; restart the service"
        )
    further = "".join(f";{name}={value}" for name, value in (parameters or {}).items())
    path = f"command/{kind}?config={digest};by={plain_name(by or _myself())}{further}"
    return ask(address, path, max(0.1, until_s - time.monotonic()))


def _only_config(address: Address, timeout_s: float) -> Reply:
    """The configuration of the one service that a command can be meant for, or a sentence that lists them."""
    connect, machine, axis, client = address
    until_s = time.monotonic() + timeout_s
    first = ask(address, "config", timeout_s)
    if "*" not in (machine, axis):
        return first
    if first.document is None:
        return first
    try:
        session = zenoh.open(client_config((connect,), client))
    except zenoh.ZError:
        return Reply(None, f"the service at {connect} answered and is gone; ask again")
    try:
        left_s = max(_QUERY_S, until_s - time.monotonic())
        replies = session.get(f"ballscrew/{machine}/{axis}/config", timeout=left_s)
        keys = [str(reply.ok.key_expr).split("/") for reply in replies if reply.ok is not None]
    finally:
        close_within(session, 1.0)
    names = sorted({"/".join(plain_name(part) for part in key[1:3]) for key in keys if len(key) == 4})
    if len(names) > 1:
        return Reply(None, _several(names, connect))
    return first


def _several(names: list[str], connect: str) -> str:
    """The services that a command without names could be meant for."""
    first, second = names[0].split("/")
    return (
        f"several services answer at {connect}: {_listed(names)}; name the one that is meant, such as "
        f"--machine {first} --axis {second}"
    )


def _listed(names: list[str]) -> str:
    further = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + further


def _myself() -> str:
    """User and computer, for the record only; they grant nothing."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "unknown"
    return f"{user}@{socket.gethostname()}"


def ask(address: Address, path: str, timeout_s: float) -> Reply:
    """Query an axis until it answers or the time is up; then name the axes that do answer.

    It opens a session of its own for each attempt and closes it. A refusal ends the attempts at once.

    Args:
        address: The service.
        path: The key below the axis, with the parameters of the query.
        timeout_s: The longest wait, in s; names of other axes may take a second more.

    Raises:
        ConfigError: If a file of the client's keys or passwords cannot be used.
    """
    connect, machine, axis, client = address
    config = client_config((connect,), client)
    until_s = time.monotonic() + timeout_s
    selector = f"ballscrew/{machine}/{axis}/{path}"
    nobody = f"no service answers at {connect}, or it rejects this client; check endpoint, service and login"
    problem = nobody
    while time.monotonic() < until_s:
        try:
            session = zenoh.open(config)
        except zenoh.ZError:
            time.sleep(_AGAIN_S)
            continue
        try:
            for reply in session.get(selector, timeout=max(0.1, until_s - time.monotonic())):
                if reply.ok is not None:
                    names = str(reply.ok.key_expr).split("/")
                    source = (names[1], names[2]) if len(names) == 4 else (machine, axis)
                    return replace(answer_of(reply.ok.payload.to_bytes()), source=source)
                refusal = refusal_of(reply.err.payload.to_bytes()) if reply.err is not None else "Timeout"
                if refusal != "Timeout":  # what Zenoh itself says where nobody has answered
                    return Reply(None, refusal)
            with contextlib.suppress(zenoh.ZError):
                problem = absent(session, connect, machine, axis) or nobody
        finally:
            close_within(session, 1.0)
        time.sleep(_AGAIN_S)
    return Reply(None, problem)


def answer_of(data: bytes) -> Reply:
    """Return the answer in bytes that came from the network.

    Bytes that are not a JSON object give a reply with a problem; nothing is raised.
    """
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return Reply(None, "the answer is not JSON, so another program sent it; correct the endpoint")
    if not isinstance(document, dict):
        return Reply(
            None, "the answer is not a JSON object, so another program sent it; correct the endpoint"
        )
    return Reply(document)


def refusal_of(data: bytes) -> str:
    """The text of a refusal, safe for a terminal.

    It has at most 300 characters, all of them printable.
    """
    text = data[:_LONGEST].decode("utf-8", "replace")
    return "".join(c for c in text if c.isprintable()) or "refused without a reason"


_QUERY_S = 1.0
_MOST = 8


def absent(session: zenoh.Session, connect: str, machine: str, axis: str) -> str | None:
    """Name the axes that are there instead.

    Args:
        session: An open session.
        connect: Its endpoint, for the sentence.
        machine: The requested machine; may be `*`.
        axis: The requested axis; may be `*`.

    Returns:
        A sentence with the options to use; None if the requested axis is there, or if no axis is.

    Raises:
        zenoh.ZError: If the session is closed.
    """
    alive_key = zenoh.KeyExpr(f"ballscrew/{machine}/{axis}/alive")
    axes = set()
    for reply in session.liveliness().get("ballscrew/*/*/alive", timeout=_QUERY_S):
        if reply.ok is None:
            continue
        if alive_key.intersects(reply.ok.key_expr):
            return None
        axes.add("/".join(plain_name(part) for part in str(reply.ok.key_expr).split("/")[1:3]))
    return _sentence(sorted(axes), connect, f"{machine}/{axis}") if axes else None


def _sentence(axes: list[str], connect: str, requested: str) -> str:
    """The axes that are there, the first of them by name, and how to select one."""
    if len(axes) == 1:
        return f"at {connect} answers {axes[0]}, not {requested}; name it with --machine and --axis"
    return f"at {connect} answer {_listed(axes)}, not {requested}; name one with --machine and --axis"
