"""What the times of a log say: sensors slower than its rows are good in between; milliseconds are named."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import observer
from observer.align.aligner import AlignPlan, frames_of_log
from observer.align.log_times import doubt_of_times
from observer.errors import ConfigError
from observer.files.logs import Log
from observer.frames import Quality
from observer.installation import parse
from tests.align.test_logs_in_doubt import CONFIG

HEAD = ("t1_degC", "speed_rpm", "ambient_degC")
GOOD, MISSING, STALE = Quality.GOOD, Quality.MISSING, Quality.STALE


def _config(more=""):
    return parse(tomllib.loads(CONFIG + more))


def _log(sensor, apart_s=1.0):
    n = len(sensor)
    values = np.column_stack([sensor, np.full(n, 1000.0), np.full(n, 22.0)])
    return Log(Path("log.csv"), np.arange(n) * apart_s, HEAD, values)


def _every(n, rows=400, first=0):
    """A reading in every n-th row, noise and all."""
    reading = 22.5 + 0.05 * np.random.default_rng(n).standard_normal(rows)
    reading[(np.arange(rows) - first) % n != 0] = np.nan
    return reading


def _sensor(log, config):
    """Quality and freshness of the sensor in each row."""
    (block,) = frames_of_log(log, AlignPlan.of(config))
    return block.quality[:, 0], block.fresh[:, 0]


@pytest.mark.parametrize(("n", "first"), [(4, 0), (5, 3), (50, 0)])
def test_a_sensor_slower_than_the_rows_is_good_between_its_values(n, first):
    quality, fresh = _sensor(_log(_every(n, 800, first)), _config())
    assert (quality[first:] == GOOD).all()
    np.testing.assert_array_equal(np.flatnonzero(fresh) % n, first)


def test_a_value_of_a_slow_sensor_that_does_not_come_is_missing_until_one_comes():
    reading = _every(4)
    reading[[100, 200, 204, 208]] = np.nan
    bad = np.flatnonzero(_sensor(_log(reading), _config())[0] == MISSING)
    # missing once more than 6 s, one and a half intervals, have passed since the last value
    np.testing.assert_array_equal(bad, [103, *range(203, 212)])


def test_values_missing_at_random_are_missing():
    rng = np.random.default_rng(7)
    for share in (0.1, 0.5, 0.6, 0.7):
        reading = np.where(rng.random(2000) < share, np.nan, _every(1, 2000))
        quality, _ = _sensor(_log(reading), _config())
        np.testing.assert_array_equal(quality == MISSING, np.isnan(reading))


@pytest.mark.parametrize("given", ["8.0", "{ t1 = 8 }"])
def test_the_interval_may_be_given(given):
    reading = np.full(40, np.nan)
    reading[[0, 8, 16, 24, 36]] = 22.5  # too few to learn from
    assert np.count_nonzero(_sensor(_log(reading), _config())[0] == MISSING) == 35
    bad = np.flatnonzero(_sensor(_log(reading), _config(f"sensor_period_s = {given}\n"))[0] != GOOD)
    np.testing.assert_array_equal(bad, [])
    reading[24] = np.nan
    bad = np.flatnonzero(_sensor(_log(reading), _config(f"sensor_period_s = {given}\n"))[0] != GOOD)
    np.testing.assert_array_equal(bad, np.arange(29, 36))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("{ t9 = 4.0 }", 'sensor_period_s: "t9" is not a sensor; give one of t1'),
        ("-1.0", "sensor_period_s"),
        ('"often"', "sensor_period_s"),
    ],
)
def test_an_impossible_interval_is_rejected(given, said):
    with pytest.raises(ConfigError, match=said):
        _config(f"sensor_period_s = {given}\n")


def _warming(rows=3600):
    """An hour at one row a second: a screw warms up, and cools."""
    time_s = np.arange(rows, dtype=float)
    rise_K = np.where(time_s < 1800, 1 - np.exp(-time_s / 900), np.exp(-(time_s - 1800) / 900))
    return 22.0 + 10.0 * rise_K + 0.05 * np.random.default_rng(1).standard_normal(rows)


@pytest.mark.parametrize("seconds", [0.02, 0.1, 0.5])
def test_milliseconds_are_named(seconds):
    reading = np.repeat(_warming(), round(1 / seconds))
    log = _log(reading, 1000.0 * seconds)
    assert "looks like milliseconds where seconds are expected" in doubt_of_times(log, _config())
    assert doubt_of_times(_log(reading, seconds), _config()) is None


def test_a_row_a_minute_for_weeks_is_not_taken_for_milliseconds():
    """A machine that warms every day, logged each minute for a month."""
    minute = np.arange(30 * 1440)
    at_work = (minute % 1440 > 420) & (minute % 1440 < 1020)
    log = _log(22.0 + 8.0 * at_work + 0.05 * np.random.default_rng(2).standard_normal(len(minute)), 60.0)
    assert doubt_of_times(log, _config()) is None


@pytest.mark.parametrize("gone", ["t1", "ambient", "none"])
def test_no_replay_counts_steps_that_are_not_good_without_a_reason(tmp_path, gone):
    config = tmp_path / "machine.toml"
    config.write_text(CONFIG)
    rows = ["time_s," + ",".join(HEAD)]
    for i in range(600):
        away = 300 <= i < 400
        t1, air = "" if away and gone == "t1" else 22.5, "" if away and gone == "ambient" else 22
        rows.append(f"{i},{t1},1000,{air}")
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    summary = observer.load(config).replay(tmp_path / "log.csv").summary
    not_good = sum(n for name, n in summary["quality"].items() if name != "good")
    assert not_good > 0
    assert sum(summary["reasons"].values()) >= not_good
    if gone != "none":
        assert summary["reasons"][f"channel {gone}_degC is missing"] == 100
