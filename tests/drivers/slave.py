"""Modbus slaves with the faults that users meet, on a pty and on TCP; they know nothing of pymodbus."""

from __future__ import annotations

import asyncio
import contextlib
import os
import struct
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

Send = Callable[[bytes], None]


def crc(data: bytes) -> bytes:
    """The checksum of an RTU frame."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


@dataclass
class Slave:
    """Units whose registers hold their own number, plus 1000 times the unit's, or a word of `words`.

    One request is answered after the other. `late_s` is by how much each `every`-th reply is late, `twice_s`
    after which each reply comes again, `cut` sends the first half of each `every`-th reply only.
    """

    units: tuple[int, ...] = (1,)
    words: dict[int, int] = field(default_factory=dict)
    illegal: frozenset[int] = frozenset()
    silent: frozenset[int] = frozenset()
    most: int = 125
    most_code: int = 3
    every: int = 0
    late_s: float = 0.0
    twice_s: float | None = None
    cut: bool = False
    foreign: bytes = b""  # sent before each reply
    dead: tuple[int, ...] = ()
    dead_after_s: float | None = None  # when the gateway says so, holding up the others
    transaction: Callable[[int], int] = lambda number: number
    reply_s: float = 0.0
    requests: list[tuple[int, int, int, int]] = field(default_factory=list)
    answered: int = 0

    def pdu(self, unit: int, function: int, first: int, count: int) -> bytes | None:
        """The reply without its frame; None for silence."""
        self.requests.append((unit, function, first, count))
        asked = set(range(first, first + count))
        if unit not in self.units or asked & self.silent:
            return None
        if count > self.most:
            return bytes((function | 0x80, self.most_code))
        if asked & self.illegal:
            return bytes((function | 0x80, 2))
        words = [self.words.get(r, 1000 * unit + r) for r in range(first, first + count)]
        return struct.pack(f">BB{count}H", function, 2 * count, *words)

    async def answer(self, unit: int, function: int, first: int, count: int, frame, send: Send) -> None:
        """Answer one request."""
        if unit in self.dead:
            if self.dead_after_s is not None:
                await asyncio.sleep(self.dead_after_s)
                send(frame(bytes((function | 0x80, 11))))
            return
        body = self.pdu(unit, function, first, count)
        if body is None:
            return
        self.answered += 1
        is_odd_one = self.every and self.answered % self.every == 0
        await asyncio.sleep(self.late_s if is_odd_one and not self.cut else self.reply_s)
        reply = frame(body)
        send(self.foreign + (reply[: len(reply) // 2] if is_odd_one and self.cut else reply))
        if self.twice_s is not None:
            asyncio.get_running_loop().call_later(self.twice_s, send, reply)

    async def serve_rtu(self, bytes_in: asyncio.Queue[bytes], send: Send) -> None:
        """Answer RTU requests, one after the other."""
        buffer = b""
        while True:
            buffer += await bytes_in.get()
            while len(buffer) >= 8:
                request, rest = buffer[:8], buffer[8:]
                if crc(request[:6]) != request[6:]:
                    buffer = buffer[1:]
                    continue
                buffer = rest
                unit, function, first, count = struct.unpack(">BBHH", request[:6])

                def frame(body: bytes, unit: int = unit) -> bytes:
                    return bytes((unit,)) + body + crc(bytes((unit,)) + body)

                await self.answer(unit, function, first, count, frame, send)

    async def serve_tcp(self, bytes_in: asyncio.Queue[bytes], send: Send) -> None:
        """Answer Modbus TCP requests, one after the other."""
        buffer = b""
        while True:
            buffer += await bytes_in.get()
            while len(buffer) >= 12:
                number, protocol, length, unit, function, first, count = struct.unpack(
                    ">HHHBBHH", buffer[:12]
                )
                if protocol or length != 6:
                    buffer = b""
                    break
                buffer = buffer[12:]

                def frame(body: bytes, number: int = number, unit: int = unit) -> bytes:
                    return struct.pack(">HHHB", self.transaction(number), 0, len(body) + 1, unit) + body

                await self.answer(unit, function, first, count, frame, send)


@asynccontextmanager
async def on_pty(slave: Slave) -> AsyncIterator[str]:
    """A serial port with this slave at its other end."""
    master, other = os.openpty()
    tty.setraw(other)
    os.set_blocking(master, False)
    queue: asyncio.Queue[bytes] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    loop.add_reader(master, lambda: queue.put_nowait(os.read(master, 4096)))

    def send(data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(master, data)

    task = asyncio.create_task(slave.serve_rtu(queue, send))
    try:
        yield os.ttyname(other)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        loop.remove_reader(master)
        os.close(master)
        os.close(other)


@asynccontextmanager
async def on_tcp(slave: Slave, *, rtu: bool = False, to_all: bool = False) -> AsyncIterator[int]:
    """The port of a server with this slave behind it, which sends replies to their client, or `to_all`."""
    writers: list[asyncio.StreamWriter] = []
    tasks: list[asyncio.Task[None]] = []

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        queue: asyncio.Queue[bytes] = asyncio.Queue()

        def send(data: bytes) -> None:
            for target in writers if to_all else [writer]:
                target.write(data)

        tasks.append(asyncio.create_task((slave.serve_rtu if rtu else slave.serve_tcp)(queue, send)))
        with contextlib.suppress(OSError):
            while data := await reader.read(4096):
                queue.put_nowait(data)
        writers.remove(writer)
        writer.close()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for writer in writers:
            writer.close()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
