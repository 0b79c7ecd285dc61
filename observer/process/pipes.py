"""Messages with keys on a pipe between two processes."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

_HEAD = struct.Struct(">HI")


def framed(key: str, payload: bytes) -> bytes:
    """Return a message as written to the pipe: two lengths, key and payload."""
    name = key.encode()
    return _HEAD.pack(len(name), len(payload)) + name + payload


def messages(read: Callable[[int], bytes]) -> Iterator[tuple[str, bytes]]:
    """Yield the messages of a pipe until it closes; `read(n)` returns n bytes, fewer only at the end."""
    while len(head := read(_HEAD.size)) == _HEAD.size:
        name, size = _HEAD.unpack(head)
        key, payload = read(name), read(size)
        if len(key) + len(payload) < name + size:
            return
        yield key.decode(), payload
