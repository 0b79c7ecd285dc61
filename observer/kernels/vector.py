"""Some neighbouring numbers of a row at a time, as many as a register of the processor holds.

What is worked out this way gives the same bits whatever LANES is: no sum goes across the lanes. A row is as
wide as whole pairs of registers. Compiled, these functions are those of `vector.pxd`.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

LANES: Final = 4


def registers(count: int) -> int:
    """How many registers so many numbers fill."""
    return -(-count // LANES)


def none() -> Any:
    """Zeros."""
    return np.zeros(LANES)


def load(A: Any, a: int, q: int) -> Any:
    """Register q of row a."""
    return _within(A[a], q).copy()


def load_of(A: Any, d: int, a: int, q: int) -> Any:
    """Register q of row a of matrix d."""
    return _within(A[d, a], q).copy()


def load_at(A: Any, q: int) -> Any:
    """Register q of a vector."""
    return _within(A, q).copy()


def store(A: Any, a: int, q: int, value: Any) -> None:
    """Put a register back."""
    _within(A[a], q)[:] = value


def store_at(A: Any, q: int, value: Any) -> None:
    """Put register q of a vector back."""
    _within(A, q)[:] = value


def mirror_block(A: Any, p: int, q: int) -> None:
    """The square in rows p and columns q of registers, transposed, to rows q and columns p."""
    rows, columns = slice(p * LANES, (p + 1) * LANES), slice(q * LANES, (q + 1) * LANES)
    A[columns, rows] = A[rows, columns].T


def _within(row: Any, q: int) -> Any:
    part = row[q * LANES : (q + 1) * LANES]
    if len(part) < LANES:
        raise IndexError(f"register {q} of a row of {len(row)}")
    return part
