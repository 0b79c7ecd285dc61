"""Numbers that are the same, to the last bit, on every computer.

The arrays of a plant hold cosines and results of LAPACK: rounded to nine digits, those that differ by a
rounding become the same again.
"""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

DIGITS = 9
NEGLIGIBLE = 1e-13
"""Of the largest entry of an array, below which one is nothing."""


def rounded(value: float) -> float:
    return float(f"{value:.{DIGITS - 1}e}")


def firm(value: Any) -> Any:
    """A record with every number in it rounded, and all else as it is."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        flat = value.ravel()
        finite = np.abs(flat[np.isfinite(flat)])
        least = NEGLIGIBLE * float(finite.max(initial=0.0))
        out = [rounded(x) if abs(x) > least or not math.isfinite(x) else 0.0 for x in flat.tolist()]
        return np.array(out).reshape(value.shape)
    if isinstance(value, float):
        return rounded(value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: firm(getattr(value, f.name)) for f in fields(value)})
    if isinstance(value, tuple):
        parts = [firm(part) for part in value]
        return type(value)._make(parts) if hasattr(value, "_make") else tuple(parts)
    return value
