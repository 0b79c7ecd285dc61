"""What strangers can make the OPC UA server hold before they have a session: not much."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.common.connection import SecureConnection, TransportLimits
from asyncua.crypto.security_policies import SecurityPolicyNone
from asyncua.ua.ua_binary import struct_to_binary, uatcp_to_binary

from observer.config.outlets import Opcua
from tests.bus.router import free_port
from tests.outlets.feeding import OutletsFeed, fed_outlets
from tests.patience import PATIENCE_S, until

pytestmark = pytest.mark.system
STRANGERS = 6
SENT = 40_000_000
MOST_MB = 30.0
"""Six connections took the process from 140 to 505 MB; what one read of a socket takes is in this."""


def own_MB(pid: int) -> float:
    """Memory that a process has for itself."""
    rows = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8").splitlines()
    return sum(int(row.split()[1]) for row in rows if row.startswith(("Private_", "Swap:"))) / 1024


def _ended_never(connection: socket.socket, data: bytes = bytes(65536)) -> None:
    """A message that is said to be long, and is sent without its end."""
    connection.sendall(b"MSGF" + (200_000_000).to_bytes(4, "little"))
    for _ in range(SENT // len(data)):
        connection.sendall(data)


def _greeted(connection: socket.socket) -> SecureConnection:
    channel = SecureConnection(SecurityPolicyNone(), TransportLimits())
    connection.sendall(
        uatcp_to_binary(ua.MessageType.Hello, ua.Hello(ReceiveBufferSize=65535, SendBufferSize=65535))
    )
    connection.recv(65536)
    request = ua.OpenSecureChannelRequest()
    request.Parameters.RequestedLifetime = 3_600_000
    request.Parameters.SecurityMode = ua.MessageSecurityMode.None_
    connection.sendall(channel.message_to_binary(struct_to_binary(request), ua.MessageType.SecureOpen))
    answer = connection.recv(65536)
    channel.security_token.ChannelId = int.from_bytes(answer[8:12], "little")
    channel.security_token.TokenId = 13
    return channel


def _in_chunks(connection: socket.socket) -> None:
    """A message in chunks, of which the last one never comes."""
    channel = _greeted(connection)
    data = channel.message_to_binary(bytes(SENT + 65536))
    connection.sendall(data[: SENT // 65536 * 65535])


def _asked_without_listening(connection: socket.socket) -> None:
    """Questions that everybody may ask, whose answers are not taken."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    channel = _greeted(connection)
    request = struct_to_binary(ua.GetEndpointsRequest())
    for _ in range(4000):
        connection.sendall(channel.message_to_binary(request, request_id=2))


def _made_sessions(connection: socket.socket) -> None:
    """Sessions that are made and never taken up."""
    channel = _greeted(connection)
    request = struct_to_binary(ua.CreateSessionRequest())
    for _ in range(4000):
        connection.sendall(channel.message_to_binary(request, request_id=2))
        connection.recv(65536)


def _stranger(port: int, sends: Callable[[socket.socket], None], held: list[socket.socket]) -> None:
    connection = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    held.append(connection)
    with suppress(OSError):
        sends(connection)


async def test_strangers_take_little_memory_and_nobody_elses_turn():
    port = free_port()
    url = f"opc.tcp://127.0.0.1:{port}"
    with fed_outlets(opcua=Opcua(listen=url)) as feed:
        assert feed.said()["reason"] is None
        feed.estimate()
        async with Client(url):
            pass
        for sends in (_ended_never, _in_chunks, _asked_without_listening, _made_sessions):
            held: list[socket.socket] = []
            before_MB = own_MB(feed.process.pid)
            threads = [threading.Thread(target=_stranger, args=(port, sends, held)) for _ in range(STRANGERS)]
            for thread in threads:
                thread.start()
            most_MB = _most_MB(feed, threads)
            try:
                async with Client(url, timeout=PATIENCE_S) as client:
                    assert await client.nodes.objects.get_children()
            finally:
                for connection in held:
                    connection.close()
            assert most_MB - before_MB < MOST_MB, sends.__name__


def _most_MB(feed: OutletsFeed, threads: list[threading.Thread]) -> float:
    most_MB = [0.0]

    def are_done() -> bool:
        most_MB.append(own_MB(feed.process.pid))
        return not any(thread.is_alive() for thread in threads)

    until(are_done, pause_s=0.05)
    return max(most_MB)


def _is_closed(connection: socket.socket) -> bool:
    try:
        return connection.recv(1, socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


async def test_the_oldest_connections_without_login_make_room():
    port = free_port()
    url = f"opc.tcp://127.0.0.1:{port}"
    with fed_outlets(opcua=Opcua(listen=url)) as feed:
        assert feed.said()["reason"] is None
        async with Client(url) as active:
            held = [socket.create_connection(("127.0.0.1", port)) for _ in range(40)]
            until(lambda: [_is_closed(c) for c in held] == [True] * 32 + [False] * 8)
            async with Client(url) as client:
                assert await client.nodes.objects.get_children()
            assert await active.nodes.objects.get_children()
            until(lambda: all(_is_closed(c) for c in held))  # who has no session in time goes, too
        for connection in held:
            connection.close()
