"""The C library's functions under its names there, for the kernel functions that Python calls as well.

The engine `filterpy`, the specification and tests call some of them. Functions on bytes exist only compiled,
in `setup.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from math import fmod
from types import SimpleNamespace
from typing import Any, Final

from numpy import floor, isfinite, isinf, isnan, rint

cython: Any = SimpleNamespace(address=lambda record: record)
"""The compiler's own module; a record stands for its address here."""

INFINITY: Final = math.inf
NAN: Final = math.nan
M_PI: Final = math.pi


def _as_in_c(function: Callable[[float], float], overflow: float) -> Callable[[float], float]:
    """The function with C's answers where Python raises: NaN outside its domain, `beyond` on overflow."""

    def answer(value: float) -> float:
        try:
            return function(value)
        except ValueError:
            return NAN
        except OverflowError:
            return overflow

    return answer


cos, sin, sqrt = _as_in_c(math.cos, NAN), _as_in_c(math.sin, NAN), _as_in_c(math.sqrt, NAN)
exp, expm1 = _as_in_c(math.exp, INFINITY), _as_in_c(math.expm1, INFINITY)


def log(value: float) -> float:
    """The natural logarithm."""
    return math.log(value) if value > 0.0 else -INFINITY if value == 0.0 else NAN


def lrint(value: float) -> int:
    """The nearest whole number."""
    return int(rint(value))


def _only_compiled(*_: Any) -> Any:
    raise NotImplementedError


bytes_of = take_bytes = float_at = octet_at = put_float32 = put_float64 = _only_compiled

__all__ = [
    "INFINITY", "M_PI", "NAN", "bytes_of", "cos", "cython", "exp", "expm1", "float_at", "floor", "fmod",
    "isfinite", "isinf", "isnan", "log", "lrint", "octet_at", "put_float32", "put_float64", "rint", "sin",
    "sqrt", "take_bytes",
]  # fmt: skip
