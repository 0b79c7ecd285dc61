"""Lists that name tests by their paths name tests that exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.kernels.test_build import NUMERIC as CHECKED_BY_BOUNDS
from tests.processors import NUMERIC

TESTS = Path(__file__).parents[1]


@pytest.mark.parametrize("folder", NUMERIC)
def test_a_folder_that_runs_on_every_processor_exists(folder):
    assert list((TESTS / folder).glob("test_*.py"))


@pytest.mark.parametrize("path", CHECKED_BY_BOUNDS)
def test_a_test_that_runs_with_checked_bounds_exists(path):
    assert (TESTS.parent / path).exists()
