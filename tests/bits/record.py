"""Records the bits of every case: `python -m tests.bits.record`, where they are meant to be others.

Each array is described by its type, its shape, the beginning of the SHA-256 of its bytes and some of its
numbers, written so that no bit is lost.
"""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tests.bits.cases import CASES

RECORDED = Path(__file__).with_name("recorded.json")
SAMPLES = 8
GOLDEN = 0.6180339887498949
DIGEST = 24
"""How much of a digest is kept, in hexadecimal digits."""
GIVEN, MATRICES = "given", "~"
"""The name of what a case begins with, and how the name of an array begins that went through LAPACK."""


def canonical(array: np.ndarray) -> np.ndarray:
    """The array in one piece, with every NaN the same."""
    array = np.ascontiguousarray(array)
    return np.where(np.isnan(array), np.nan, array) if array.dtype.kind == "f" else array


def places(size: int) -> list[int]:
    """Where the samples of an array of so many numbers are: in every part, in no one column, the last too."""
    spread = {int(size * (GOLDEN * i % 1.0)) for i in range(1, SAMPLES)}
    return sorted(spread | {size - 1}) if size else []


def shown(value: Any) -> str:
    return float(value).hex() if isinstance(value, np.floating) else str(value)


def record_of(array: np.ndarray) -> str:
    """Type, shape and digest of an array, and some of its numbers."""
    array = canonical(array)
    flat = array.ravel()
    digest = hashlib.sha256(array.tobytes()).hexdigest()[:DIGEST]
    samples = [shown(flat[i]) for i in places(flat.size)] if array.dtype != np.uint8 else []
    return " ".join([array.dtype.str[1:], "×".join(map(str, array.shape)) or "1", digest, *samples])


def run(name: str) -> dict[str, np.ndarray]:
    """The arrays of a case; some of its numbers are no numbers on purpose."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return CASES[name]()


def library() -> dict[str, str]:
    """Digests of what the C library, numpy and LAPACK make of a few numbers."""
    x = [0.001 * k + 0.37 * (k % 17) for k in range(1, 400)]
    functions = {f.__name__: f for f in (math.exp, math.expm1, math.sin, math.cos, math.log)}
    values = {name: np.array([f(-v if "exp" in name else v) for v in x]) for name, f in functions.items()}
    values |= {f"numpy.{f.__name__}": f(-np.array(x)) for f in (np.exp, np.expm1, np.cos)}
    A = np.array(x[:144]).reshape(12, 12)
    S = A @ A.T + np.eye(12)
    values[MATRICES] = np.concatenate(
        [S.ravel(), np.linalg.solve(S, A).ravel(), np.linalg.inv(S).ravel(), np.linalg.eigh(S)[0]]
    )
    return {name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in values.items()}


def written(library_: dict[str, str], cases: dict[str, dict[str, str]]) -> str:
    """The record as JSON, an array on a line."""
    parts = [
        json.dumps(case) + ": " + json.dumps(arrays, indent=1, ensure_ascii=False)
        for case, arrays in cases.items()
    ]
    own = json.dumps(library_, indent=1)
    return f'{{"library": {own},\n"cases": {{\n' + ",\n".join(parts) + "\n}}\n"


def main() -> None:
    cases = {name: {key: record_of(array) for key, array in run(name).items()} for name in CASES}
    RECORDED.write_text(written(library(), cases), encoding="utf-8")


if __name__ == "__main__":
    main()
