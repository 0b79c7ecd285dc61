"""Which heats are large for their speed, on numbers with a known answer."""

import numpy as np
import pytest

from observer.fleet.report import MeanHeat, compare_with_fleet


def _bearing(machine: str, heat_W_rpm: float, speed_rpm: float = 1500.0, kind: str = "a") -> MeanHeat:
    return MeanHeat(machine, kind, "left", speed_rpm, heat_W_rpm * speed_rpm)


def test_the_one_bearing_that_runs_hot_is_found_at_whatever_speed_it_runs():
    rng = np.random.default_rng(1)
    heats = [_bearing(f"m{i}", 0.006 * (1 + 0.03 * rng.normal()), 1400 + 20 * i) for i in range(10)]
    found = compare_with_fleet([*heats, _bearing("bad", 0.009, 1450)])
    assert [b.machine for b in found if b.hot] == ["bad"]
    (bad,) = (b for b in found if b.machine == "bad")
    assert bad.usual_W == pytest.approx(0.006 * 1450, rel=0.03)
    assert bad.others == 10


def test_machines_at_other_speeds_or_of_other_types_are_no_like():
    slow = [_bearing(f"s{i}", 0.006, 500.0) for i in range(5)]
    other = [_bearing(f"o{i}", 0.001, 1500.0, "b") for i in range(5)]
    (alone,) = (
        b for b in compare_with_fleet([*slow, *other, _bearing("alone", 0.02)]) if b.machine == "alone"
    )
    assert (alone.usual_W, alone.others, alone.hot) == (None, 0, False)


def test_a_fleet_that_scatters_calls_none_hot_that_scatters_no_more():
    heats = [_bearing(f"m{i}", 0.006 * (0.6 + 0.1 * i)) for i in range(9)]
    assert not any(b.hot for b in compare_with_fleet(heats))


def test_logs_of_one_machine_count_once():
    heats = [_bearing(f"m{i}", 0.006) for i in range(2) for _ in range(50)]
    assert all(b.usual_W is None for b in compare_with_fleet([*heats, _bearing("bad", 0.02)]))


def test_a_standstill_has_no_usual_heat():
    assert [b.usual_W for b in compare_with_fleet([_bearing(f"m{i}", 0.0, 0.0) for i in range(5)])] == [
        None
    ] * 5
