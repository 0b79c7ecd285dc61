"""How arrays lie in memory for the kernels: rows of whole vector registers, and many arrays in one piece."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.kernels import STATES

Array = NDArray[np.float64]
Records = np.ndarray[Any, Any]
"""An array of a `state_type`; one of its elements has the numbers as attributes."""
_LINE = 8  # numbers in a line of the cache


def state_type(name: str) -> np.dtype[Any]:
    """Return numpy's type of a structure of `states.pxd`: its numbers by name."""
    return np.dtype((np.record, STATES[name]))


def padded_width(columns: int, register: int) -> int:
    """Return the width of an array's rows in memory that the inner loops run over: whole vector registers."""
    return -(-columns // register) * register


def aligned_zeros(shape: tuple[int, ...]) -> Array:
    """Return zeros that begin with a line of the processor's cache: no register lies in two of them."""
    size = math.prod(shape)
    memory = np.zeros(size + _LINE)
    first = -memory.ctypes.data % (8 * _LINE) // 8
    return memory[first : first + size].reshape(shape)


def pad_rows(array: Array, width: int) -> Array:
    """Return the array with its last axis padded with zeros to a width."""
    padded = aligned_zeros((*array.shape[:-1], width))
    padded[..., : array.shape[-1]] = array
    return padded


def packed(record: Any) -> Any:
    """Return a NamedTuple, and those in it, with every array in the one layout that kernels take."""
    if isinstance(record, np.ndarray):
        return np.require(record, requirements=("C", "W"))
    return type(record)(*map(packed, record)) if isinstance(record, tuple) else record


class Fields:
    """How arrays lie one behind the other in one piece of memory; cuts them out of bytes, for good."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        """Take a type with a field for each array."""
        self.dtype = dtype

    def column(self, data: bytes, name: str) -> Any:
        """Return one array."""
        return np.ndarray((), self.dtype, data)[name]

    def columns(self, data: bytes, names: tuple[str, ...]) -> list[Any]:
        """Return some of them."""
        whole = np.ndarray((), self.dtype, data)
        return [whole[name] for name in names]


class Bundle:
    """Arrays by name that lie one behind the other, so that all of them are copied at once, as `octets`."""

    def __init__(self, fields: Fields) -> None:
        """Allocate it."""
        self.fields, self.octets = fields, np.zeros(fields.dtype.itemsize, np.uint8)
        self._whole = np.ndarray((), fields.dtype, self.octets)

    @classmethod
    def of(cls, like: Mapping[str, Any]) -> Bundle:
        """Return a bundle with copies of arrays, by their names."""
        bundle = cls(Fields(np.dtype([(n, a.dtype, a.shape) for n, a in like.items()], align=True)))
        for name, array in like.items():
            bundle[name][...] = array
        return bundle

    def __getitem__(self, name: str) -> Any:
        return self._whole[name]

    def over(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return one array of floats over that one and those behind it."""
        fields: Any = self.fields.dtype.fields
        return np.ndarray(shape, float, self.octets, fields[name][1])
