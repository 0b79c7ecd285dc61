"""Numbers in bytes, for kernels that run as Python; compiled, C does it (`setup.py`).

Both take the machine to be little-endian, as all are that the kernels are built for.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np


def bytes_of(octets: Any, count: int) -> bytes:
    """The first bytes of an array, for good."""
    return bytes(memoryview(octets)[:count])


def take_bytes(octets: Any, data: bytes) -> None:
    """Fill an array with bytes."""
    memoryview(octets)[:] = data


def float_at(data: bytes, at: int) -> float:
    """The float of 64 bits that begins at a byte."""
    value: float = struct.unpack_from("<d", data, at)[0]
    return value


def octet_at(data: bytes, at: int) -> int:
    """One byte."""
    return data[at]


def put_float32(octets: Any, at: int, value: float) -> None:
    """Write a float of 32 bits, the least significant byte first."""
    with np.errstate(over="ignore"):
        octets[at : at + 4] = np.frombuffer(np.float32(value).tobytes(), np.uint8)


def put_float64(octets: Any, at: int, value: float) -> None:
    """Write a float of 64 bits, the most significant byte first."""
    struct.pack_into(">d", octets, at, value)
