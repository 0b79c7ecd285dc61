"""What was worked out once, kept for the next who asks."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Kept(Generic[Value]):
    """Results of a pure function by key, the newest so many; nobody can tell but by the clock."""

    def __init__(self, most: int) -> None:
        self._most, self._store = most, dict[Hashable, Value]()

    def get(self, key: Hashable, work_out: Callable[[], Value]) -> Value:
        """Return what is kept under a key, worked out if it is not."""
        value = self._store.pop(key) if key in self._store else work_out()
        self._store[key] = value
        if len(self._store) > self._most:
            del self._store[next(iter(self._store))]
        return value
