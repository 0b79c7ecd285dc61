"""What a machine was doing, read from a log that is written by hand, and what logs lack."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer.config import Config
from observer.discovery.localise import Course, course_of, missing_excitation, speeds_rpm
from observer.fit.runs import prepare
from observer.fit.steps import SteppedRun
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.cycle import PHASES
from tests.logs.machines import machine
from tests.logs.simulated import frames

# Minutes: at rest, at work, a short rest, at work again, a long rest.
ENDS_MIN = (10.0, 50.0, 60.0, 80.0, 140.0)
AT_WORK = (False, True, False, True, False)


def course(working: Any) -> Course:
    """A log of the small bar whose bearing turns while `working(minute)`, and warms it with a lag."""
    config = machine(source=[machine().source[1].model_dump(exclude_unset=True)])
    time_s = np.arange(0.0, 60 * ENDS_MIN[-1], 2.0)
    on = np.array([working(t / 60) for t in time_s])
    level_degC = np.full(len(time_s), 20.0)
    for k in range(1, len(time_s)):
        level_degC[k] = level_degC[k - 1] + 2.0 / 600.0 * (20.0 + 15.0 * on[k] - level_degC[k - 1])
    columns = {"n_rpm": 1200.0 * on} | {s.channel: level_degC for s in config.sensor}
    run = prepare(config, [frames(config, time_s, columns)], "log")
    return course_of(config, SteppedRun(run, config, build_plant(config)))


def at_work(minute: float) -> bool:
    return bool(AT_WORK[int(np.searchsorted(ENDS_MIN, minute, side="right"))])


def test_the_phases_of_a_shift() -> None:
    found = course(at_work)
    minute = 0.5 * (np.arange(len(found.phase)) + 0.5)

    def phases(begin: float, end: float) -> set[str]:
        """Half a minute's grace at each change."""
        return {PHASES[p] for p in found.phase[(minute > begin + 0.5) & (minute < end - 0.5)]}

    assert phases(0.0, 10.0) == {"isothermal"}
    assert phases(13.0, 22.0) == {"heat_up"}  # a time constant of ten minutes; the rate is smoothed
    assert phases(35.0, 50.0) == {"steady"}  # after 25 min, 8 % of the first rate
    assert phases(50.0, 60.0) == {"dwell"}
    assert phases(63.0, 66.0) == {"heat_up"}
    assert phases(80.0, 140.0) == {"cool_down"}
    assert not found.working[minute > 80.5].any()
    assert found.running_s[-1] == pytest.approx(60 * 60.0, abs=60.0)
    assert found.speed_rpm[(minute > 11) & (minute < 49)] == pytest.approx(1200.0)
    assert found.ambient_degC == pytest.approx(20.0)


# ---- what logs lack ----


def made(speeds: FloatArray, working: FloatArray | None = None) -> Course:
    turns = speeds > 0 if working is None else working.astype(bool)
    zero = np.zeros(len(speeds))
    return Course(zero.astype(np.int64), speeds, zero, turns, zero, zero)


def run(*, minutes: float = 60.0, rise_K: float = 5.0) -> Any:
    """As much of a run as is asked for."""
    measured = np.linspace(20.0, 20.0 + rise_K, 10)[:, None] * np.ones(3)
    return SimpleNamespace(duration_s=60 * minutes, measured_degC=measured, start_degC=np.full(3, 20.0))


GOOD = made(np.repeat([0.0, 500.0, 1500.0], 20))


def clauses(config: Config, course: Course, **of_run: float) -> tuple[str, ...]:
    return missing_excitation(config, [run(**of_run)], [course])


def test_good_logs_lack_nothing() -> None:
    assert clauses(machine(), GOOD) == ()


@pytest.mark.parametrize(
    ("course", "of_run", "words"),
    [
        (GOOD, {"minutes": 20.0}, ("20 min", "30 min are needed")),
        (GOOD, {"rise_K": 0.5}, ("0.50 K", "1.0 K are needed")),  # 20 × 0.05 K
        (made(np.zeros(40)), {}, ("never turns",)),
        (made(np.repeat([0.0, 800.0], 20)), {}, ("800 rpm only", "effects of speed are not identifiable")),
        (made(np.repeat([0.0, 800.0, 840.0], 20)), {}, ("rpm only",)),  # a twentieth apart is no other speed
        (made(np.repeat([0.0, 800.0, 1600.0], [20, 20, 5])), {}, ("800 rpm only",)),  # 2.5 min do not count
        (made(np.repeat([500.0, 1500.0], 20)), {}, ("never rests",)),
    ],
)
def test_each_lack_is_one_clause(course: Course, of_run: dict[str, float], words: tuple[str, ...]) -> None:
    (clause,) = clauses(machine(), course, **of_run)
    for word in words:
        assert word in clause


def test_lacks_add_up_and_the_best_log_counts() -> None:
    poor = clauses(machine(), made(np.zeros(40)), minutes=10.0, rise_K=0.1)
    assert len(poor) == 3
    both = missing_excitation(machine(), [run(minutes=10.0, rise_K=0.1), run()], [made(np.zeros(40)), GOOD])
    assert both == ()


def test_a_machine_without_a_speed_is_not_asked_for_one() -> None:
    config = machine(source=[machine().source[0].model_dump(exclude_unset=True)])
    heated = replace(made(np.zeros(40)), working=np.repeat([False, True], 20))
    assert clauses(config, heated) == ()


def test_speeds_are_those_that_last() -> None:
    assert speeds_rpm([GOOD]) == [500.0, 1500.0]
    assert speeds_rpm([made(np.linspace(100.0, 3000.0, 12))]) == []  # a ramp is no speed


# ---- by hand, mean by mean ----


def stepped(speed_rpm: Any, *, period_s: float = 30.0, level_degC: Any = None, more: Any = None) -> Any:
    """As much of a run as its course is read from: two frames to each mean, one a second after the other."""
    speeds = np.repeat(np.asarray(speed_rpm, dtype=float), 2)
    columns = {"n_rpm": speeds} | {name: np.repeat(values, 2) for name, values in (more or {}).items()}
    means = len(speeds) // 2
    level = np.full(means, 20.0) if level_degC is None else np.asarray(level_degC, dtype=float)
    ticks = SimpleNamespace(
        mean=np.arange(means),
        first=2 * np.arange(means),
        time_s=period_s * np.arange(1.0, means + 1),
        measured_degC=np.column_stack([level, level]),
    )
    values = np.column_stack(list(columns.values()))

    class Frames:
        channels = tuple(columns)

        def __len__(self) -> int:
            return len(values)

    frames = Frames()
    frames.values = values  # type: ignore[attr-defined]
    return SimpleNamespace(ticks=ticks, run=SimpleNamespace(frames=frames))


def settings(**ambient: Any) -> Any:
    source = SimpleNamespace(speed_channel="n_rpm", power_channel=None, position_channel=None)
    return SimpleNamespace(
        source=[source], ambient=SimpleNamespace(**{"channel": None, "temperature_degC": None} | ambient)
    )


def test_it_works_from_a_fiftieth_of_its_fastest_on() -> None:
    found = course_of(settings(), stepped([0.0, 19.0, 21.0, -1000.0, 0.0]))
    np.testing.assert_array_equal(found.working, [False, False, True, True, False])
    np.testing.assert_array_equal(found.speed_rpm, [0.0, 19.0, 21.0, 1000.0, 0.0])
    np.testing.assert_array_equal(found.running_s, [0.0, 0.0, 30.0, 60.0, 60.0])
    still = course_of(settings(), stepped([0.0, 1e-12, 0.0]))
    assert not still.working.any(), "what is nothing is no work, be it the most there is"
    assert {PHASES[phase] for phase in still.phase} == {"isothermal"}
    at_once = course_of(settings(), stepped([900.0] * 3))
    np.testing.assert_array_equal(at_once.running_s, [30.0, 60.0, 90.0])
    config = settings()
    config.source = [SimpleNamespace(speed_channel=None, power_channel="P_W", position_channel=None)]
    unheated = course_of(config, stepped([0.0] * 3, more={"P_W": [0.0, 1e-12, 0.0]}))
    assert not unheated.working.any()


def test_a_mean_is_over_its_frames_and_a_gap_is_standstill() -> None:
    run = stepped([1000.0] * 5)
    run.run.frames.values[:6, 0] = [500.0, 700.0, np.nan, 1000.0, np.inf, np.nan]
    np.testing.assert_array_equal(course_of(settings(), run).speed_rpm, [600.0, 500.0, 0.0, 1000.0, 1000.0])


def test_several_steps_may_share_a_mean() -> None:
    run = stepped(np.repeat([100.0, 300.0, 500.0, 600.0, 600.0], 2) + np.tile([0.0, 100.0], 5))
    run.ticks.mean = np.repeat(np.arange(5), 2)
    run.ticks.time_s, run.ticks.measured_degC = 30.0 * np.arange(1.0, 6.0), np.full((5, 2), 20.0)
    np.testing.assert_array_equal(course_of(settings(), run).speed_rpm, [150.0, 350.0, 550.0, 650.0, 650.0])


def test_power_is_work_as_well_and_the_ambient_is_what_is_known_of_it() -> None:
    config = settings(temperature_degC=23.0)
    config.source = [
        SimpleNamespace(speed_channel=None, power_channel="P_W", position_channel="x_m"),
        SimpleNamespace(speed_channel=None, power_channel="Q_W", position_channel=None),
    ]
    more = {
        "P_W": [0.0, 100.0, 0.0, 0.0, 0.0],
        "Q_W": [0.0, 0.0, 3.0, 0.0, 0.0],
        "x_m": [0.1, 0.2, 0.3, 0.4, 0.5],
        "air_degC": [20.0, 21.0, 22.0, 23.0, 24.0],
    }
    found = course_of(config, stepped([0.0] * 5, more=more))
    np.testing.assert_array_equal(found.working, [False, True, True, False, False])
    np.testing.assert_array_equal(found.speed_rpm, np.zeros(5))
    np.testing.assert_array_equal(found.position_m, [0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_array_equal(found.ambient_degC, np.full(5, 23.0))
    config.ambient = SimpleNamespace(channel="air_degC", temperature_degC=None)
    np.testing.assert_array_equal(
        course_of(config, stepped([0.0] * 5, more=more)).ambient_degC, [20.0, 21.0, 22.0, 23.0, 24.0]
    )
    nothing_known = course_of(settings(), stepped([0.0]))
    assert (nothing_known.ambient_degC.tolist(), nothing_known.position_m.tolist()) == ([20.0], [0.0])


@pytest.mark.parametrize(("rest_s", "phase"), [(1499.5, "dwell"), (1500.0, "cool_down")])
def test_a_rest_of_less_than_25_minutes_with_work_after_it_is_a_dwell(rest_s: float, phase: str) -> None:
    rest = 51  # means, from the end of the first to that of the last
    speeds = [0.0, 0.0, *[900.0] * 20, *[0.0] * rest, *[900.0] * 5]
    found = course_of(settings(), stepped(speeds, period_s=rest_s / (rest - 1)))
    named = [PHASES[p] for p in found.phase]
    assert set(named[:2]) == {"isothermal"}
    assert set(named[22 : 22 + rest]) == {phase}
    assert set(named[2:22] + named[22 + rest :]) <= {"heat_up", "steady"}
    ended = course_of(settings(), stepped([*[900.0] * 20, *[0.0] * 5]))
    assert {PHASES[p] for p in ended.phase[20:]} == {"cool_down"}, "no work comes after it"


def test_heating_up_is_from_a_seventh_of_the_fastest_on() -> None:
    """0.15 of it: here the level rises by 1 K a mean, then by 0.2 K, then by 0.1 K; the rate is smoothed."""
    level = 20.0 + np.concatenate([[0.0], np.cumsum(np.repeat([1.0, 0.2, 0.1], 20))])
    found = course_of(settings(), stepped([900.0] * 61, level_degC=level))
    named = [PHASES[p] for p in found.phase]
    assert set(named[5:37]) == {"heat_up"}
    assert set(named[44:]) == {"steady"}
    with_gaps = level.copy()
    with_gaps[[7, 8, 30]] = np.nan
    run = stepped([900.0] * 61, level_degC=with_gaps)
    run.ticks.measured_degC[50, 0] = np.nan
    np.testing.assert_array_equal(course_of(settings(), run).phase, found.phase)
    run.ticks.measured_degC[:, 0] = np.nan  # one sensor is enough
    np.testing.assert_array_equal(course_of(settings(), run).phase, found.phase)


@pytest.mark.parametrize("means", [1, 2, 3, 4])
def test_a_log_of_a_minute_or_two_has_its_phases_too(means: int) -> None:
    found = course_of(settings(), stepped([900.0] * means, level_degC=20.0 + np.arange(means)))
    assert len(found.phase) == means
    assert {PHASES[p] for p in found.phase} <= {"heat_up", "steady"}
