"""Caches results of functions: check, search and variants build the same machine many times."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec

from observer.frames import FloatArray

P = ParamSpec("P")


class _Arguments:
    """Arguments that are equal where all of their bytes are, arrays included."""

    __slots__ = ("arguments", "data")

    def __init__(self, arguments: tuple[object, ...]) -> None:
        self.arguments, self.data = arguments, pickle.dumps(arguments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Arguments) and self.data == other.data

    def __hash__(self) -> int:
        return hash(self.data)


def cached(size: int) -> Callable[[Callable[P, FloatArray]], Callable[P, FloatArray]]:
    """Return a decorator that caches results of a function that returns one array.

    Arguments are compared by their pickled bytes, arrays included. Each caller gets a copy. Calling the
    function with keyword arguments raises `TypeError`.

    Args:
        size: Number of results that are stored; the one unused for longest goes first.
    """

    def decorate(function: Callable[P, FloatArray]) -> Callable[P, FloatArray]:
        @lru_cache(maxsize=size)
        def lookup(key: _Arguments) -> FloatArray:
            return function(*key.arguments)  # type: ignore[call-arg,arg-type]

        @wraps(function)
        def copied(*arguments: P.args, **named: P.kwargs) -> FloatArray:
            if named:
                raise TypeError(f"{function.__name__} takes its arguments by position")
            return lookup(_Arguments(arguments)).copy()

        return copied

    return decorate
