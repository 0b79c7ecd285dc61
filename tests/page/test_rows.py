"""Rows of a recording are read as Python's own `float` reads their cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.kernels import read_rows

PLACE = np.array([0, -1, 1], np.intp)


def _read(text: str) -> list[list[float]]:
    out = np.full((text.count("\n") + 1, 2), 99.0)
    return out[: read_rows(text.encode(), PLACE, out)].tolist()


def _number(cell: str) -> float:
    ((number, other),) = _read(f"{cell},x,{cell}\n")
    assert number == other or math.isnan(number)
    return number


@given(st.floats(-1e290, 1e290))
def test_a_number_is_read_back_as_the_recorder_writes_it(value):
    assert _number(repr(value)) == pytest.approx(value, rel=1e-13, abs=1e-290)


@given(st.integers(-(10**15), 10**15), st.integers(-22, 22))
def test_a_number_of_few_digits_is_the_one_that_python_reads(whole, power):
    assert _number(f"{whole}e{power}") == float(f"{whole}e{power}")
    if -15 <= power < 0:
        assert _number(f"{whole / 10**-power:.{-power}f}") == pytest.approx(whole / 10**-power, rel=1e-15)


@pytest.mark.parametrize(
    "cell",
    ["0", "-0.0", "+1.5", "1.", ".5", "1E3", "1e-05", "1700000000.03", "0.1", "1e300",
     "123456789012345678901", "0.000000000000000000000001234567890123456789", "1e-400",
     "1e400", "-1e400", "0e999"],
)  # fmt: skip
def test_a_spelling_of_a_number(cell):
    assert _number(cell) == pytest.approx(float(cell), rel=1e-15)


@pytest.mark.parametrize("cell", ["", " ", "-", ".", "e5", "1e", "1e+", "1e5x", "1e1.5", "nan", "1.2.3"])
def test_anything_but_a_number_is_missing(cell):
    assert math.isnan(_number(cell))


def test_rows_with_other_cells_are_left_out():
    assert _read("1,2\n3,4,5\n6,7,8,9\n\n10,,11\n12,13,1") == [[3.0, 5.0], [10.0, 11.0]]
