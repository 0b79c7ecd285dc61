"""What the C library does for compiled kernels, for those that run as Python, under its names there.

Numbers in bytes take the machine to be little-endian, as all are that the kernels are built for.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from math import fmod
from typing import Any, Final

import numpy as np
from numpy import floor, isfinite, isinf, isnan, rint

try:
    import cython  # type: ignore[import-untyped]
except ModuleNotFoundError:  # of the build only: without it kernels are compiled, constants read
    cython = None

INFINITY: Final = math.inf
NAN: Final = math.nan
M_PI: Final = math.pi


def _as_in_c(function: Callable[[float], float], beyond: float) -> Callable[[float], float]:
    """The function with C's answers where Python raises: NaN outside its domain, `beyond` on overflow."""

    def answer(value: float) -> float:
        try:
            return function(value)
        except ValueError:
            return NAN
        except OverflowError:
            return beyond

    return answer


cos, sin, sqrt = _as_in_c(math.cos, NAN), _as_in_c(math.sin, NAN), _as_in_c(math.sqrt, NAN)
exp, expm1 = _as_in_c(math.exp, INFINITY), _as_in_c(math.expm1, INFINITY)


def log(value: float) -> float:
    """The natural logarithm."""
    return math.log(value) if value > 0.0 else -INFINITY if value == 0.0 else NAN


def lrint(value: float) -> int:
    """The nearest whole number."""
    return int(rint(value))


__all__ = [
    "INFINITY",
    "M_PI",
    "NAN",
    "cos",
    "cython",
    "exp",
    "expm1",
    "floor",
    "fmod",
    "isfinite",
    "isinf",
    "isnan",
    "log",
    "lrint",
    "rint",
    "sin",
    "sqrt",
]  # fmt: skip


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
