"""What a sensor's offset usually is, and that a slow drift shows in it."""

from __future__ import annotations

import numpy as np
import pytest

from observer.quality.alarm_states import KnownOffset, taken

LEARN_H, LIMIT_K = 30.0, 0.5


def _after(values, known: KnownOffset | None = None, sigma_K: float = 0.05) -> KnownOffset:
    """A value an hour."""
    known = known or KnownOffset()
    for value in values:
        known = taken(known, value, sigma_K, 1.0, LEARN_H, LIMIT_K)
    return known


def test_an_offset_that_stays_is_usual_whatever_it_is():
    rng = np.random.default_rng(3)
    known = _after(1.2 + 0.1 * rng.standard_normal(2000))
    assert not known.moved
    assert known.usual_K == pytest.approx(1.2, abs=0.06)
    assert known.now_K == pytest.approx(1.2, abs=0.2)


def test_a_slow_drift_is_reported_beyond_the_limit_and_not_learnt_away():
    rate_K_h = 0.2 / 120.0
    drift_K = rate_K_h * np.arange(600)
    known, reported_K = _after(np.zeros(40)), None
    for hour, value in enumerate(drift_K):
        known = taken(known, value, 0.05, 1.0, LEARN_H, LIMIT_K)
        if known.moved and reported_K is None:
            reported_K = rate_K_h * hour
    assert reported_K == pytest.approx(LIMIT_K, abs=0.02)
    assert known.moved


def test_a_moved_offset_clears_with_hysteresis():
    moved = _after([0.8] * 40, _after(np.zeros(40)))
    assert moved.moved
    assert _after([0.4] * 40, moved).moved
    assert not _after([0.2] * 40, moved).moved


@pytest.mark.parametrize("sigma_K", [0.2, float("nan"), float("inf")])
def test_an_unknown_offset_changes_nothing(sigma_K):
    known = _after(np.zeros(40))
    assert _after([3.0] * 40, known, sigma_K) == known


def test_nothing_is_reported_during_learning():
    assert not _after([0.0] * 15 + [2.0] * 15).moved
