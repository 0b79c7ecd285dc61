"""Keeps results that are asked for again: check, search and variants build the same machine many times."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec

from observer.frames import FloatArray

P = ParamSpec("P")


class _Asked:
    """Arguments that are equal where all of their bytes are, arrays included."""

    __slots__ = ("arguments", "data")

    def __init__(self, arguments: tuple[object, ...]) -> None:
        self.arguments, self.data = arguments, pickle.dumps(arguments)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Asked) and self.data == other.data

    def __hash__(self) -> int:
        return hash(self.data)


def kept(most: int) -> Callable[[Callable[P, FloatArray]], Callable[P, FloatArray]]:
    """Have a function of positional arguments keep its last results; each caller gets a copy of its own."""

    def keeping(function: Callable[P, FloatArray]) -> Callable[P, FloatArray]:
        @lru_cache(maxsize=most)
        def found(asked: _Asked) -> FloatArray:
            return function(*asked.arguments)  # type: ignore[call-arg,arg-type]

        @wraps(function)
        def copied(*arguments: P.args, **named: P.kwargs) -> FloatArray:
            if named:
                raise TypeError(f"{function.__name__} takes its arguments by position")
            return found(_Asked(arguments)).copy()

        return copied

    return keeping
