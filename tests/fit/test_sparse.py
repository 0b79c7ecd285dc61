"""Where a nut is taken to have been between rows that cannot show it."""

from __future__ import annotations

import numpy as np
import pytest

from observer.config.machine import Config
from observer.fit.forward import _undetermined
from observer.fit.runs import filled, shows_ends
from observer.frames import FrameBlock, NutPath
from tests.discovery.small import problem_of
from tests.logs.machines import machine

NUT = {
    "name": "nut", "shape": "nut", "length_m": 0.02, "position_channel": "x_m", "speed_channel": "n_rpm",
    "torque_Nm": 0.3, "share": 0.5,
}  # fmt: skip


def log_of(every_s: float, speed_rpm: float, lead_m: float = 0.005) -> tuple[Config, FrameBlock]:
    """An hour of a nut that runs to and fro between 0.1 and 0.3 m for its second half."""
    config = machine(source=[NUT])
    time_s = np.arange(0.0, 3600.0, every_s)
    running = time_s >= 1800.0
    gone_m = np.where(running, (time_s - 1800.0) * speed_rpm / 60.0 * lead_m, 0.0)
    place_m = 0.1 + np.abs((gone_m + 0.2) % 0.4 - 0.2)
    values = np.full((len(time_s), len(config.channels)), 20.0)
    values[:, config.channels.index("n_rpm")] = np.where(running, speed_rpm, 0.0)
    values[:, config.channels.index("x_m")] = place_m
    path = NutPath(time_s, place_m, np.arange(len(time_s) + 1), *np.full((2, len(time_s)), np.nan))
    fresh = np.ones(values.shape, dtype=bool)
    return config, FrameBlock(
        channels=config.channels,
        time_s=time_s,
        dt_s=np.diff(time_s, prepend=time_s[0]),
        values=values,
        fresh=fresh,
        quality=np.zeros(values.shape, dtype=np.int8),
        age_s=np.zeros(values.shape),
        path={"x_m": path},
    )


@pytest.mark.parametrize(("speed_rpm", "further"), [(1438.0, 0), (1490.3, 1)], ids=["in turn", "anywhere"])
def test_between_rows_a_minute_apart_it_runs_over_what_it_shows_of_its_stroke(
    speed_rpm: float, further: int
) -> None:
    """And, where rows meet it anywhere, a little further."""
    config, log = log_of(60.0, speed_rpm)
    path = filled(log, config).path["x_m"]
    late = path.time_s > 1860.0
    shown = log.path["x_m"].position_m[log.time_s >= 1800.0]
    beyond = further * np.ptp(shown) / (len(shown) - 1)
    low, high = shown.min() - beyond, shown.max() + beyond
    inside = path.position_m[late]
    assert inside.min() == pytest.approx(low, abs=1e-3)
    assert inside.max() == pytest.approx(high, abs=1e-3)
    assert np.all(np.diff(path.time_s) > 0.0)
    # as long in every part of its way: the spread of an even chance
    assert inside.std() == pytest.approx((high - low) / np.sqrt(12.0), rel=0.1)
    # and no nearer to one end than the shown places are: they are part of the way
    nearer = (shown.mean() - (low + high) / 2) / 6
    assert inside.mean() == pytest.approx((low + high) / 2 + nearer, abs=0.004)
    # at each row it is where the row says, and while it stands it stands
    at_rows = path.position_m[path.offset[1:] - 1]
    np.testing.assert_allclose(at_rows, log.path["x_m"].position_m)
    assert path.offset[29] == 29


@pytest.mark.parametrize(("every_s", "speed_rpm"), [(2.0, 1438.0), (60.0, 20.0)])
def test_a_nut_that_rows_show_keeps_its_way(every_s: float, speed_rpm: float) -> None:
    config, log = log_of(every_s, speed_rpm)
    assert filled(log, config).path["x_m"].offset.tolist() == log.path["x_m"].offset.tolist()


@pytest.mark.parametrize(
    ("turns_a_row", "shown"),
    [(1.0, False), (1.003, False), (0.5, False), (0.497, False), (0.81, True), (0.3, True)],
)
def test_as_under_a_stroboscope_a_nut_does_not_show_how_far_it_runs(
    turns_a_row: float, *, shown: bool
) -> None:
    """Once to and fro from row to row it seems to stand, or nearly so; half as often, to leap."""
    way = 0.13 + turns_a_row * np.arange(30)
    jitter = 1e-3 * np.sin(7.0 * np.arange(30))
    assert shows_ends(np.abs(2.0 * (way % 1.0) - 1.0) + jitter, 1.0) == shown


def test_a_nut_that_seems_to_stand_runs_over_what_the_whole_log_shows() -> None:
    """At 1440 rpm it comes back to 0.1 m at every row; before, it was seen to creep up to 0.3 m."""
    config, log = log_of(60.0, 1440.0)
    creeping = log.time_s < 1800.0
    log.path["x_m"].position_m[creeping] = np.linspace(0.1, 0.3, np.count_nonzero(creeping))
    path = filled(log, config).path["x_m"]
    inside = path.position_m[path.time_s > 1860.0]
    assert (inside.min(), inside.max()) == pytest.approx((0.1, 0.3), abs=0.2 / 24)
    assert inside.std() == pytest.approx(0.2 / np.sqrt(12.0), rel=0.1)


def test_where_a_nut_left_its_heat_is_open_but_not_how_much() -> None:
    config, log = log_of(60.0, 1438.0)
    forward = problem_of(config, [log]).forward
    setting, bands = forward._with_stretches(config)
    inputs = forward._inputs(setting, forward.runs[0])
    law_W = np.zeros_like(inputs.law_W)
    law_W[:, 0] = 12.0
    steady = inputs._replace(law_W=law_W, law_jump_W=np.zeros_like(law_W))
    moved = list(_undetermined(forward.runs[0], setting.plant, steady, bands))
    assert len(moved) > 2
    for more_W in moved:
        assert np.abs(more_W).max() > 1.0
        np.testing.assert_allclose(more_W.sum(axis=1), 0.0, atol=1e-9)


def test_between_two_rows_a_heat_may_have_changed_at_the_one_or_the_other_or_in_between() -> None:
    config, log = log_of(60.0, 1438.0)
    forward = problem_of(config, [log]).forward
    setting, bands = forward._with_stretches(config)
    inputs = forward._inputs(setting, forward.runs[0])
    heat_W = inputs.law_W[-1, 0]
    (at,) = np.flatnonzero(inputs.law_jump_W[:, 0])
    assert inputs.law_W[at, 0] == pytest.approx(heat_W / 2)  # it goes evenly from one row to the next
    as_recorded, whenever, *_ = _undetermined(forward.runs[0], setting.plant, inputs, bands)
    for more_W, by_W in ((as_recorded, heat_W / 2), (whenever, heat_W / np.sqrt(12.0))):
        assert more_W[at, 0] == pytest.approx(by_W)
        assert np.flatnonzero(more_W.any(axis=1)).tolist() == [at]
