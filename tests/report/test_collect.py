from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from observer.report.collect import Decimator


@given(st.lists(st.integers(0, 60), min_size=1, max_size=12), st.integers(2, 25), st.integers(0, 2**32 - 1))
def test_blocks_of_any_length_leave_the_same_samples(lengths: list[int], most: int, seed: int) -> None:
    total = sum(lengths)
    if total == 0:
        return
    values = np.random.default_rng(seed).normal(size=(total, 2))
    columns = {"t": np.arange(total, dtype=float), "v": values}
    whole, parts = Decimator(most), Decimator(most)
    whole.add(columns)
    ends = np.cumsum([0, *lengths])
    for a, b in itertools.pairwise(ends):
        parts.add({name: array[a:b] for name, array in columns.items()})
    for name in columns:
        for read in (Decimator.last, Decimator.low, Decimator.high):
            np.testing.assert_array_equal(read(whole, name), read(parts, name))


@given(st.integers(1, 5000), st.integers(2, 300))
def test_few_samples_remain_evenly_spaced_and_no_extreme_is_lost(total: int, most: int) -> None:
    values = np.random.default_rng(total).normal(size=total)
    decimator = Decimator(most)
    decimator.add({"t": np.arange(total, dtype=float), "v": values})
    t = decimator.last("t")
    assert len(t) <= most
    assert len(t) > most // 2 or len(t) == total
    assert t[-1] == total - 1
    assert len(np.unique(np.diff(t)[:-1])) <= 1  # all but the last bucket hold the same number of rows
    assert decimator.low("v").min() == values.min()
    assert decimator.high("v").max() == values.max()


def test_missing_values_hide_no_others() -> None:
    decimator = Decimator(2)
    decimator.add({"v": np.array([1.0, np.nan, np.nan, np.nan, 5.0, np.nan])})
    # four rows a bucket
    np.testing.assert_array_equal(decimator.low("v"), [1.0, 5.0])
    np.testing.assert_array_equal(decimator.high("v"), [1.0, 5.0])
    decimator.add({"v": np.array([np.nan, 7.0, np.nan, 9.0])})
    # eight rows a bucket
    np.testing.assert_array_equal(decimator.low("v"), [1.0, 9.0])
    np.testing.assert_array_equal(decimator.high("v"), [7.0, 9.0])
