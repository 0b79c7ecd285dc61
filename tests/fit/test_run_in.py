"""What a calibration finds of running in: by hand, and from logs of a bearing that does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.config.machine import Config
from observer.fit.calibrate import calibrate
from observer.fit.parameters import replaced
from observer.fit.run_in import Fading, Settles, begins_cold, nearest, spread
from observer.fit.runs import prepare
from observer.frames import FrameBlock
from tests.logs.machines import machine
from tests.logs.simulated import made_log

SCALE = "source.bearing.l.scale"


def log_with(share: float, seed: int) -> FrameBlock:
    effect = {"kind": "run_in", "target": "bearing.l", "fraction": share, "time_s": 1500.0}
    return made_log(replaced(machine(effect=[effect]), {SCALE: 1.3}), seed, minutes=200.0)


def of_the_bearing(config: Config, *logs: FrameBlock) -> tuple[float, float, float]:
    found = calibrate(config, [[log] for log in logs])
    share, time_s, sigma = (
        found.written[f"source.bearing.l.{key}"] for key in ("run_in", "run_in_s", "run_in_tolerance")
    )
    return share, time_s, sigma


def test_the_nearest_exponential_of_a_part_is_that_part() -> None:
    found = nearest(Settles(np.array([0.0, 0.2]), np.diag([0.0, 0.01**2])))
    assert found == pytest.approx(Fading(0.2, 3600.0, 0.01))


def test_parts_with_two_time_constants_are_one_between_them() -> None:
    found = nearest(Settles(np.array([0.1, 0.1]), np.eye(2) * 1e-4))
    assert 1500.0 < found.time_s < 2500.0
    assert found.share == pytest.approx(0.19, abs=0.015)


def test_starts_that_differ_say_more_than_one_that_may() -> None:
    one, alike, apart = (
        spread(0.2, [Fading(share, 1800.0, 0.005) for share in shares])
        for shares in ([0.2], [0.2, 0.2, 0.2], [0.1, 0.2, 0.3])
    )
    assert alike < one < apart
    assert one == pytest.approx(np.hypot(0.04, 0.01))


def test_a_bearing_that_runs_in_is_found_with_its_time() -> None:
    share, time_s, sigma = of_the_bearing(machine(), log_with(0.25, 1))
    assert abs(share - 0.25) < 2.0 * sigma < 0.15
    assert 1000.0 < time_s < 2300.0


def test_a_bearing_that_does_not_run_in_is_found_not_to() -> None:
    share, _, sigma = of_the_bearing(machine(), log_with(0.0, 2))
    assert abs(share) < 2.0 * sigma < 0.06


def test_logs_whose_starts_differ_leave_a_next_one_more_open() -> None:
    _, _, alike = of_the_bearing(machine(), log_with(0.2, 3), log_with(0.2, 4))
    _, _, apart = of_the_bearing(machine(), log_with(0.05, 3), log_with(0.35, 4))
    assert apart > 1.5 * alike


def test_a_log_that_begins_warm_says_nothing_of_a_cold_start() -> None:
    log = log_with(0.25, 1)
    warm = replace(log, values=np.where(np.char.endswith(log.channels, "degC"), log.values + 8.0, log.values))
    source = machine().source[1]
    assert source.name == "bearing.l"
    cold, not_cold = (begins_cold(machine(), source, prepare(machine(), [one], "")) for one in (log, warm))
    assert cold
    assert not not_cold
