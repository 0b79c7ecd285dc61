"""The C library's functions, by their names there, for kernels that run as Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from math import fmod
from typing import Final

from numpy import floor, isfinite, isinf, isnan, rint

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
    "INFINITY", "M_PI", "NAN", "cos", "exp", "expm1", "floor", "fmod", "isfinite", "isinf", "isnan", "log",
    "lrint", "rint", "sin", "sqrt",
]  # fmt: skip
