"""What the first user sees, for ten minutes: `make demo-under-load`; too long for every day."""

import pytest

from tests.system.beside_truth import SHARE, watched

pytestmark = [pytest.mark.system, pytest.mark.slow]


@pytest.mark.timeout(1200)
def test_in_a_busy_terminal_the_heats_agree_with_the_truth_for_ten_minutes() -> None:
    found = watched(600.0)
    assert found["qualities"].get("good", 0) >= 0.9 * found["steps"] > 900, found
    assert min(found["within"].values()) >= SHARE, found
