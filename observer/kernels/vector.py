"""Some neighbouring numbers of a row at a time, as many as a register of the processor holds.

Results have the same bits for any LANES, because no sum crosses the lanes. The width of a row is a whole
number of pairs of registers. The compiled functions are those of `vector.pxd`.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

LANES: Final = 4


def registers(count: int) -> int:
    """Return the number of registers for `count` numbers."""
    return -(-count // LANES)


def zero_lanes() -> Any:
    """Zeros."""
    return np.zeros(LANES)


def load(A: Any, a: int, q: int) -> Any:
    """Register q of row a."""
    return _register(A[a], q).copy()


def load_of(A: Any, d: int, a: int, q: int) -> Any:
    """Register q of row a of matrix d."""
    return _register(A[d, a], q).copy()


def load_at(A: Any, q: int) -> Any:
    """Register q of a vector."""
    return _register(A, q).copy()


def store(A: Any, a: int, q: int, value: Any) -> None:
    """Put a register back."""
    _register(A[a], q)[:] = value


def store_at(A: Any, q: int, value: Any) -> None:
    """Put register q of a vector back."""
    _register(A, q)[:] = value


def mirror_block(A: Any, p: int, q: int) -> None:
    """The square in rows p and columns q of registers, transposed, to rows q and columns p."""
    rows, columns = slice(p * LANES, (p + 1) * LANES), slice(q * LANES, (q + 1) * LANES)
    A[columns, rows] = A[rows, columns].T


def _register(row: Any, q: int) -> Any:
    part = row[q * LANES : (q + 1) * LANES]
    if len(part) < LANES:
        raise IndexError(f"register {q} of a row of {len(row)}")
    return part
