"""What a machine was doing, read from a log that is written by hand, and what logs lack."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.discovery.localise import Course, course_of, missing_excitation, speeds_rpm
from observer.files.logs import Log
from observer.fit.runs import Run, prepare
from observer.fit.steps import SteppedRun
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.cycle import PHASES
from tests.logs.machines import machine

HEATER, BEARING = ([source.model_dump(exclude_unset=True)] for source in machine().source)
NUT = {"name": "nut", "shape": "nut", "length_m": 0.02, "stroke_m": [0.0, 0.4], "position_channel": "x_m"}
MEAN_ROWS = 15
"""A row every 2 s, a mean every 30 s; the first mean has the row of the start besides."""


def run_of(columns: dict[str, FloatArray], config: Config) -> Run:
    """A log of these rows; what is not said of a sensor is the column `level`."""
    level = columns.pop("level")
    columns = {s.channel: level for s in config.sensor} | columns
    log = Log(
        Path("log"), 2.0 * np.arange(len(level)), tuple(columns), np.column_stack(list(columns.values()))
    )
    return prepare(config, list(frames_of_log(log, AlignPlan.of(config))), "log")


def course(speed_rpm: Any, level: Any = 20.0, config: Config | None = None, **more: Any) -> Course:
    """The course of a log that holds these values for half a minute each."""
    config = config or machine(source=BEARING)
    means = len(speed_rpm)
    rows = [MEAN_ROWS + (i == 0) for i in range(means)]
    columns = {"n_rpm": speed_rpm, "level": level} | more
    by_row = {n: np.repeat(np.broadcast_to(v, means).astype(float), rows) for n, v in columns.items()}
    return course_of(config, SteppedRun(run_of(by_row, config), config, build_plant(config)))


def phases(found: Course, begin: int = 0, end: int | None = None) -> set[str]:
    return {PHASES[p] for p in found.phase[begin:end]}


def test_the_phases_of_a_shift() -> None:
    """At rest, 40 min at work, 10 of rest, 20 at work, an hour of rest; it warms with a lag of 10 min."""
    speeds = 1200.0 * np.repeat([0, 1, 0, 1, 0], [20, 80, 20, 40, 120])
    level = np.full(len(speeds), 20.0)
    for k in range(1, len(level)):
        level[k] = level[k - 1] + 0.05 * (20.0 + 15.0 * (speeds[k] > 0) - level[k - 1])
    found = course(speeds, level)
    assert phases(found, 0, 20) == {"isothermal"}
    assert phases(found, 26, 44) == {"heat_up"}  # the rate is smoothed over five means
    assert phases(found, 70, 100) == {"steady"}  # after 25 min, 8 % of the first rate
    assert phases(found, 100, 120) == {"dwell"}
    assert phases(found, 126, 132) == {"heat_up"}
    assert phases(found, 160) == {"cool_down"}
    assert found.running_s[-1] == 3600.0
    np.testing.assert_array_equal(found.speed_rpm, speeds)
    assert (found.ambient_degC == 20.0).all()


@pytest.mark.parametrize(
    ("speeds", "works"),
    [
        ([0.0, 19.0, 21.0, -1000.0, 0.0], [0, 0, 1, 1, 0]),
        ([900.0] * 3, [1, 1, 1]),
        ([0.0, 1e-12, 0.0], [0, 0, 0]),  # what is nothing is no work, be it the most there is
    ],
)
def test_it_works_from_a_fiftieth_of_its_fastest_on(speeds: list[float], works: list[int]) -> None:
    found = course(speeds)
    np.testing.assert_array_equal(found.working, np.array(works, dtype=bool))
    np.testing.assert_allclose(found.speed_rpm, np.abs(speeds))
    np.testing.assert_array_equal(found.running_s, 30.0 * np.cumsum(works))
    heated = course(speeds, config=machine(source=HEATER), heater_W=speeds)
    np.testing.assert_array_equal(heated.working, found.working)
    assert any(works) or phases(found) == {"isothermal"}


def test_a_mean_is_over_its_rows_and_a_gap_is_standstill() -> None:
    config = machine(source=BEARING)
    speed = np.full(5 * MEAN_ROWS + 1, 1000.0)
    speed[:8], speed[8:16], speed[16:21], speed[31:46] = 500.0, 700.0, np.nan, np.nan
    block = run_of({"n_rpm": np.ones_like(speed), "level": np.full_like(speed, 20.0)}, config)
    block.frames.values[:, block.frames.channels.index("n_rpm")] = speed
    found = course_of(config, SteppedRun(block, config, build_plant(config)))
    np.testing.assert_allclose(found.speed_rpm, [600.0, 2000.0 / 3.0, 0.0, 1000.0, 1000.0])


@pytest.mark.parametrize(
    ("ambient", "air_degC"),
    [
        ({"temperature_degC": 23.0}, [23.0] * 5),
        ({"channel": "air_degC"}, [20.0, 20.1, 20.2, 20.3, 20.4]),
    ],
)
def test_power_is_work_as_well_and_the_ambient_is_what_is_known_of_it(
    ambient: dict[str, Any], air_degC: list[float]
) -> None:
    config = machine(source=[*HEATER, NUT | {"power_channel": "Q_W"}], ambient=ambient)
    more = {
        "heater_W": [0.0, 100.0, 0.0, 0.0, 0.0],
        "Q_W": [0.0, 0.0, 3.0, 0.0, 0.0],
        "x_m": [0.1, 0.15, 0.2, 0.25, 0.3],
        "air_degC": [20.0, 20.1, 20.2, 20.3, 20.4],
    }
    found = course([0.0] * 5, config=config, **more)
    np.testing.assert_array_equal(found.working, [False, True, True, False, False])
    np.testing.assert_array_equal(found.speed_rpm, np.zeros(5))
    np.testing.assert_allclose(found.position_m, more["x_m"])
    np.testing.assert_allclose(found.ambient_degC, air_degC)


@pytest.mark.parametrize(("rest", "phase"), [(50, "dwell"), (51, "cool_down")])
def test_a_rest_of_less_than_25_minutes_with_work_after_it_is_a_dwell(rest: int, phase: str) -> None:
    """From the end of its first mean to that of its last."""
    found = course([0.0, 0.0, *[900.0] * 20, *[0.0] * rest, *[900.0] * 5])
    assert phases(found, 0, 2) == {"isothermal"}
    assert phases(found, 22, 22 + rest) == {phase}
    assert phases(found, 2, 22) | phases(found, 22 + rest) <= {"heat_up", "steady"}
    assert phases(course([*[900.0] * 20, *[0.0] * 5]), 20) == {"cool_down"}, "no work comes after it"


@pytest.mark.parametrize("unknown", [{}, {"abc": [7, 8, 30]}, {"a": [50]}, {"ab": range(61)}])
def test_heating_up_is_from_a_seventh_of_the_fastest_on(unknown: dict[str, Any]) -> None:
    """0.15 of it: here the level rises by 1 K a mean, then by 0.2 K, then by 0.1 K; the rate is smoothed.

    Some sensors are silent in some means; one is enough.
    """
    level = 20.0 + np.concatenate([[0.0], np.cumsum(np.repeat([1.0, 0.2, 0.1], 20))])
    readings = {f"{name}_degC": level.copy() for name in "abc"}
    for names, means in unknown.items():
        for name in names:
            readings[f"{name}_degC"][list(means)] = np.nan
    found = course([900.0] * 61, level, **readings)
    assert phases(found, 5, 37) == {"heat_up"}
    assert phases(found, 44) == {"steady"}


@pytest.mark.parametrize("means", [1, 2, 3, 4])
def test_a_log_of_a_minute_or_two_has_its_phases_too(means: int) -> None:
    found = course([900.0] * means, 20.0 + np.arange(means))
    assert len(found.phase) == means
    assert phases(found) <= {"heat_up", "steady"}


# ---- what logs lack ----


def made(*speeds_and_means: tuple[float, int]) -> Course:
    speeds = np.concatenate([np.full(means, speed) for speed, means in speeds_and_means])
    zero = np.zeros(len(speeds))
    return Course(zero.astype(np.int64), speeds, zero, speeds > 0, zero, zero)


GOOD, STILL = made((0.0, 20), (500.0, 20), (1500.0, 20)), made((0.0, 40))


def lacks(course: Course, minutes: float = 60.0, rise_K: float = 5.0, config: Config | None = None) -> Any:
    config = config or machine()
    rows = round(30 * minutes) + 1
    columns = {
        "n_rpm": np.ones(rows),
        "heater_W": np.ones(rows),
        "level": np.linspace(20.0, 20.0 + rise_K, rows),
    }
    return run_of(columns, config), course


@pytest.mark.parametrize(
    ("logs", "clauses"),
    [
        ([lacks(GOOD)], []),
        ([lacks(GOOD, minutes=20.0)], ["20 min, and 30 min are needed"]),
        ([lacks(GOOD, rise_K=0.5)], ["0.50 K, and 1.0 K are needed"]),  # 20 × 0.05 K
        ([lacks(STILL)], ["never turns"]),
        ([lacks(made((0.0, 20), (800.0, 20)))], ["800 rpm only, so effects of speed are not identifiable"]),
        ([lacks(made((0.0, 20), (800.0, 20), (840.0, 20)))], ["rpm only"]),  # a twentieth apart is no other
        ([lacks(made((0.0, 20), (800.0, 20), (1600.0, 5)))], ["800 rpm only"]),  # 2.5 min do not count
        ([lacks(made((500.0, 20), (1500.0, 20)))], ["never rests"]),
        ([lacks(STILL, 10.0, 0.1)], ["30 min", "1.0 K", "never turns"]),
        ([lacks(STILL, 10.0, 0.1), lacks(GOOD)], []),  # the best log counts
    ],
)
def test_each_lack_of_the_best_log_is_one_clause(logs: list[tuple[Run, Course]], clauses: list[str]) -> None:
    said = missing_excitation(machine(), *zip(*logs, strict=True))
    for clause, words in zip(said, clauses, strict=True):
        assert words in clause


def test_a_machine_without_a_speed_is_not_asked_for_one() -> None:
    config = machine(source=HEATER)
    run, course = lacks(STILL, config=config)
    assert missing_excitation(config, [run], [course]) == ()


def test_speeds_are_those_that_last() -> None:
    assert speeds_rpm([GOOD]) == [500.0, 1500.0]
    assert speeds_rpm([made(*((speed, 1) for speed in np.linspace(100.0, 3000.0, 12)))]) == []  # a ramp
