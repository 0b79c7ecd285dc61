"""Two months of a machine as configured: `make month`; too long for every day."""

from __future__ import annotations

import pytest

from tests.reference.test_selftest import as_configured


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", [11, 12])
def test_a_month_as_configured_has_at_most_one_false_reason(seed: int) -> None:
    bad, found = as_configured(30.0, seed)
    print(f"seed {seed}: {bad} steps not good in a month; {found}")
    assert len(found) <= 1
