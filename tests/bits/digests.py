"""Digests of what a case begins with, and every number of what it gives."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from observer.frames import EstimateBlock


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Every array and number in a record."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, bool | int | float):
        yield np.array(value)
    elif is_dataclass(value) and not isinstance(value, type):
        for f in fields(value):
            yield from arrays_of(getattr(value, f.name))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from arrays_of(part)


def given(*records: Any) -> np.ndarray:
    """A digest of what a case begins with: where that differs, no other bits need be the same."""
    digest = hashlib.sha256()
    for record in records:
        for array in arrays_of(record):
            digest.update(repr((array.dtype.str, array.shape)).encode() + array.tobytes())
    return np.frombuffer(digest.digest(), np.uint8)


def numbers(array: np.ndarray) -> np.ndarray:
    """An array as it is; the numbers of records, along one axis more."""
    if array.dtype.names is None:
        return array
    return array.view(float).reshape(*array.shape, array.dtype.itemsize // 8)


def state_of(state) -> dict[str, np.ndarray]:
    """Every part of an estimator's state; what is one number, in one array."""
    parts = {f"state.{f.name}": numbers(np.asarray(getattr(state, f.name))) for f in fields(state)}
    parts = {name: np.asarray(part, dtype=float) for name, part in parts.items()}
    parts["state.verdict"] = parts["state.verdict"][0]
    single = [name for name, part in parts.items() if part.ndim == 0]
    return {name: part for name, part in parts.items() if part.ndim} | {
        "state.rest": np.array([float(parts[name]) for name in single])
    }


def estimated(state, *blocks: EstimateBlock) -> dict[str, np.ndarray]:
    """The final state, and every column of the estimates of consecutive blocks, if there is any."""
    columns = {
        f.name: np.concatenate([getattr(block, f.name) for block in blocks]) for f in fields(EstimateBlock)
    }
    return {name: column for name, column in columns.items() if column.size} | state_of(state)


def words(text: object) -> np.ndarray:
    """What is said, as an array."""
    return np.frombuffer(repr(text).encode(), np.uint8)
