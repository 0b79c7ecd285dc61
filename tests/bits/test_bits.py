"""Every output of what is compiled keeps the bits that were recorded.

Where the C library, numpy or LAPACK of this computer gives other bits than where the record was made, no
outputs need be the same to the last bit: then the numbers that were recorded are compared, and the test is
skipped with the reason. `python -m tests.bits.record` records anew what is meant to be another.
"""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from tests.bits.cases import CASES
from tests.bits.record import GIVEN, MATRICES, RECORDED, library, places, record_of, run

NEAR, NEAR_BY_MATRICES = 1e-12, 1e-6
"""Relative to the largest of the numbers recorded of an array: elsewhere, and past LAPACK's results, whose
last bits the placing of a Luenberger observer's poles makes up to 1e8 times as large (seen: 3e-8).
"""


@cache
def recorded() -> dict[str, dict[str, dict[str, str]]]:
    return json.loads(RECORDED.read_text(encoding="utf-8"))


@cache
def others() -> frozenset[str]:
    """What gives other bits here than where the record was made."""
    return frozenset(name for name, digest in library().items() if recorded()["library"].get(name) != digest)


def split(line: str) -> tuple[str, str, list[str]]:
    """Type and shape, digest, and samples of a recorded line."""
    kind, shape, digest, *samples = line.split()
    return f"{kind} {shape}", digest, samples


def number(text: str) -> float:
    return float.fromhex(text) if "x" in text or text in ("nan", "inf", "-inf") else float(text)


def difference(array: np.ndarray, line: str) -> str | None:
    """How an array differs bitwise from the record, as far as the record can show; None if it does not."""
    (kind, digest, samples), (own_kind, own_digest, own) = split(line), split(record_of(array))
    if kind != own_kind:
        return f"is {own_kind}, was {kind}"
    if digest == own_digest:
        return None
    at = [i for i, (a, b) in enumerate(zip(samples, own, strict=True)) if a != b]
    if not at:
        return f"differs, but in none of the {len(own)} numbers of {array.size} that are recorded"
    first = int(places(array.size)[at[0]])
    index = tuple(int(i) for i in np.unravel_index(first, array.shape)) if array.shape else ()
    was, now = number(samples[at[0]]), number(own[at[0]])
    apart = abs(now - was) / max(abs(was), 1e-300)
    return (
        f"differs in {len(at)} of {len(own)} numbers recorded of its {array.size}, first at {index}: "
        f"{own[at[0]]} = {now!r}, was {samples[at[0]]} = {was!r}, {apart:.1e} apart"
    )


def is_near(array: np.ndarray, line: str, part: float) -> bool:
    """Whether the numbers recorded of an array are those it has, but for such a part of the largest."""
    (kind, _, samples), (own_kind, _, own) = split(line), split(record_of(array))
    if kind != own_kind:
        return False
    was, now = (np.array([number(x) for x in row]) for row in (samples, own))
    size = float(np.abs(was[np.isfinite(was)]).max(initial=0.0))
    return bool(np.allclose(now, was, rtol=part, atol=part * size, equal_nan=True))


def judged(case: str, arrays: dict[str, np.ndarray]) -> tuple[list[str], list[str]]:
    """What is wrong with the arrays of a case, and for which of them only the numbers could be compared."""
    lines, wrong, loose = recorded()["cases"][case], [], []
    if lines.keys() != arrays.keys():
        wrong.append(f"arrays come or go: {sorted(lines.keys() ^ arrays.keys())}")
    begins_same = GIVEN not in arrays or record_of(arrays[GIVEN]) == lines.get(GIVEN)
    elsewhere = bool(others() - {MATRICES})
    for name in sorted((lines.keys() & arrays.keys()) - {GIVEN}):
        found = difference(arrays[name], lines[name])
        by_matrices = not begins_same or (name.startswith(MATRICES) and MATRICES in others())
        if found is None:
            continue
        if not (elsewhere or by_matrices):
            wrong.append(f"{name} {found}")
        elif is_near(arrays[name], lines[name], NEAR_BY_MATRICES if by_matrices else NEAR):
            loose.append(name)
        else:
            why = "this computer's libraries" if begins_same else "what the case begins with"
            wrong.append(f"{name} {found} (compared by numbers only, because of {why})")
    return wrong, loose


@pytest.mark.parametrize("case", CASES)
def test_the_bits_are_those_recorded(case: str) -> None:
    arrays = run(case)
    wrong, loose = judged(case, arrays)
    assert not wrong, f"{case}:\n" + "\n".join(wrong)
    if loose:
        why = ", ".join(sorted(others())) or "what the case begins with"
        pytest.skip(f"other bits here: {why}; compared by numbers only: {', '.join(loose)}")


def test_every_case_is_recorded_and_no_other() -> None:
    assert list(recorded()["cases"]) == list(CASES)
