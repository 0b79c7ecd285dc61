"""A bus that a socketcand server shares on TCP.

It replaces python-can's client for three reasons. That client takes the end of a connection for silence, and
waits for an answer without a limit. It also calls a missing server without pause for 10 s.
"""

from __future__ import annotations

import re
import socket
from collections import deque
from typing import Any

import can
from can.interfaces.socketcand.socketcand import convert_can_message_to_ascii_message

_CONNECT_S = 3.0
_LONGEST = 4096  # characters without the end of a message
_FRAME = re.compile(r"<\s*(frame|error)\s+([0-9A-Fa-f]+)\s+(\d+\.\d*)\s*([0-9A-Fa-f\s]*)>")
_STANDARD_DIGITS = 3
_IDENTIFIER = 0x1FFFFFFF


class SocketcandBus(can.BusABC):
    """The raw frames of one bus of a server.

    It connects when it is made, and waits 3 s at most for each answer of the server.

    Args:
        channel: The bus on the server, such as `can0`.
        host: The server's name or address.
        port: Its TCP port.
        tcp_tune: Whether to switch off Nagle's algorithm.
        options: Passed to python-can.

    Raises:
        OSError: If the server cannot be reached.
        CanInitializationError: If it does not answer as a socketcand server does.
        CanOperationError: While reading, after the connection has ended.
    """

    def __init__(self, channel: str, host: str, port: int, tcp_tune: bool = False, **options: Any) -> None:
        self._is_shutdown = True  # until it is open
        self._socket = socket.create_connection((host, int(port)), timeout=_CONNECT_S)
        self._text = ""
        self._messages: deque[str] = deque()
        self.channel_info = f"socketcand on {channel}@{host}:{port}"
        try:
            if tcp_tune:
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._expect("hi")
            for request in (f"open {channel}", "rawmode"):
                self._socket.sendall(f"< {request} >".encode())
                self._expect("ok")
            super().__init__(channel=channel, **options)
        except BaseException:
            self._socket.close()
            raise
        self._is_shutdown = False

    def _expect(self, word: str) -> None:
        """Wait for a message that consists of `word`. Raises `CanInitializationError` for any other."""
        while not self._messages:
            if not self._receive(_CONNECT_S):
                raise can.CanInitializationError(
                    f'{self.channel_info} does not answer "{word}": correct host and port'
                )
        message = self._messages.popleft()
        if message.strip("<> ") != word:
            raise can.CanInitializationError(
                f'{self.channel_info} answers "{message}" instead of "{word}": correct channel, host or port'
            )

    def _receive(self, timeout_s: float | None) -> bool:
        """Wait for bytes and cut them into messages; return whether any came."""
        self._socket.settimeout(timeout_s)
        try:
            data = self._socket.recv(_LONGEST)
        except (TimeoutError, BlockingIOError):
            return False
        if not data:
            raise can.CanOperationError(f"{self.channel_info} has closed the connection: restart it")
        *messages, self._text = (self._text + data.decode("ascii", "replace")).split(">")
        if len(self._text) > _LONGEST:
            raise can.CanOperationError(
                f"{self.channel_info} is another kind of server: correct host and port"
            )
        self._messages += [f"{message.strip()}>" for message in messages]
        return True

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Return the next frame, None if none came. Raises `ValueError` for a message that is not a frame."""
        if not self._messages:
            self._receive(timeout)
        return (self._frame(self._messages.popleft()) if self._messages else None), False

    def _frame(self, text: str) -> can.Message:
        """Return the CAN frame of a message of socketcand. Raises `ValueError` for an invalid one."""
        parts = _FRAME.search(text)
        if parts is None:
            raise ValueError(text)
        kind, digits, stamp, data = parts.groups()
        is_error = kind == "error"
        return can.Message(
            timestamp=float(stamp),
            arbitration_id=int(digits, 16) & _IDENTIFIER,
            is_extended_id=is_error or len(digits) != _STANDARD_DIGITS,
            is_error_frame=is_error,
            data=bytes.fromhex(data),
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, waiting at most `timeout` s; None waits without a limit.

        Raises:
            OSError: If the connection has ended or the time is over.
        """
        self._socket.settimeout(timeout)
        self._socket.sendall(convert_can_message_to_ascii_message(msg).encode())

    def shutdown(self) -> None:
        """Close the connection. A second call has no effect."""
        super().shutdown()
        self._socket.close()
