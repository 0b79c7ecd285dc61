"""The table of faults counts what it says: estimates that do not show a fault, and for how long."""

from __future__ import annotations

import pytest

from campaigns.faults.judge import Fault, believed_for_s, is_used, unflagged
from campaigns.faults.table import Row, as_markdown

FAULT = Fault("open", frozenset({"t1"}), 10.0, 11.0, 0.2)


def estimate(time_s, quality, t1):
    return {"time_s": time_s, "quality": quality, "sensors": ["t1", "t2"], "sensor_quality": [t1, "good"]}


GOOD = [estimate(9.9, "good", "good"), estimate(10.1, "good", "good")]
FLAGGED = [estimate(10.3 + 0.1 * k, "degraded", "rejected") for k in range(5)]


def test_all_flagged_in_time():
    assert unflagged(GOOD + FLAGGED, FAULT) == 0
    assert believed_for_s(GOOD + FLAGGED, FAULT) == pytest.approx(0.1)


@pytest.mark.parametrize(("quality", "t1"), [("good", "rejected"), ("degraded", "good"), ("good", "good")])
def test_one_that_does_not_show_it_counts(quality, t1):
    seen = [*GOOD, *FLAGGED, estimate(10.9, quality, t1), estimate(11.5, "good", "good")]
    assert unflagged(seen, FAULT) == 1
    assert believed_for_s(seen, FAULT) == pytest.approx(0.9)


def test_nothing_seen_proves_nothing():
    with pytest.raises(ValueError, match="no estimates under the fault open"):
        unflagged(GOOD, FAULT)


def test_a_sensor_is_used_only_where_it_is_good():
    assert is_used(GOOD[0], frozenset({"t1", "t2"}))
    assert not is_used(FLAGGED[0], frozenset({"t1"}))


def test_a_figure_that_is_not_met_shows():
    rows = as_markdown([Row("a", "b", "c", "d", met=True), Row("e", "f", "g", "h", met=False)])
    assert rows.splitlines()[2:] == ["| a | b | c | d | yes |", "| e | f | g | h | **no** |"]
