"""How arrays lie in memory for the kernels: rows of whole vector registers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def padded_width(columns: int, register: int) -> int:
    """Return the width of an array's rows in memory that the inner loops run over: whole vector registers."""
    return -(-columns // register) * register


def pad_rows(array: Array, width: int) -> Array:
    """Return the array with its last axis padded with zeros to a width."""
    padded = np.zeros((*array.shape[:-1], width))
    padded[..., : array.shape[-1]] = array
    return padded


def packed(record: Any) -> Any:
    """Return a NamedTuple, and those in it, with every array in the one layout that kernels take."""
    if isinstance(record, np.ndarray):
        return np.require(record, requirements=("C", "W"))
    return type(record)(*map(packed, record)) if isinstance(record, tuple) else record
