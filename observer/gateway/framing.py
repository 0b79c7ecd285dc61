"""Messages on a pipe: two lengths, a key and a payload."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

_HEAD = struct.Struct(">HI")


def framed(key: str, payload: bytes) -> bytes:
    """A message as it goes down the pipe."""
    name = key.encode()
    return _HEAD.pack(len(name), len(payload)) + name + payload


def messages(read: Callable[[int], bytes]) -> Iterator[tuple[str, bytes]]:
    """Give the messages of a pipe until it closes; `read` gives what is asked for, less at the end only."""
    while len(head := read(_HEAD.size)) == _HEAD.size:
        name, size = _HEAD.unpack(head)
        key, payload = read(name), read(size)
        if len(key) + len(payload) < name + size:
            return
        yield key.decode(), payload
