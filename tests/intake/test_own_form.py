"""A log in our own form gives the same bits as ever, and what `[log]` says of others leaves it alone."""

from __future__ import annotations

import numpy as np
import pytest

from observer.errors import LogError
from observer.files.logs import read_log
from observer.files.writer import write_log
from observer.intake.reading import read_channels
from tests.intake.machine import Truth, configured, read, truth

FOREIGN = """
[log]
separator = ";"
decimal = ","
timezone = "Europe/Berlin"
"""


def written(path, was: Truth, **changes: np.ndarray):
    columns = {name: getattr(was, name) for name in was.__slots__ if name != "time_s"}
    columns["t1_degC"] = np.where(np.arange(len(was.time_s)) % 5, was.t1_degC / 3.0, np.nan)
    write_log(path, was.time_s, columns | changes)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet"])
@pytest.mark.parametrize("table", ["", FOREIGN])
def test_the_same_bits(tmp_path, suffix, table):
    path = written(tmp_path / f"log{suffix}", truth())
    config = configured(tmp_path, table)
    ours, plain = read_channels(path, config), read_log(path, config.channels)
    assert ours.channels == plain.channels
    np.testing.assert_array_equal(ours.time_s, plain.time_s)
    np.testing.assert_array_equal(ours.values, plain.values)
    assert not ours.joined


def test_a_renamed_column_of_our_form(tmp_path):
    was = truth()
    path = written(tmp_path / "log.csv", was, motor_degF=1.8 * was.t1_degC + 32.0)
    log = read(path, '\n[log.columns]\nt1_degC = { column = "motor_degF", unit = "degF" }\n')
    np.testing.assert_allclose(log.values[:, log.channels.index("t1_degC")], was.t1_degC, atol=1e-9)


def test_inputs_that_hold_change_at_their_row(tmp_path):
    was = truth()
    speed_rpm = np.where(np.arange(len(was.time_s)) < 100, 0.0, 1000.0)
    path = written(tmp_path / "log.csv", was, screw_speed_rpm=speed_rpm)
    log = read(path, "\n[log]\nhold = true\n")
    speed = log.values[:, log.channels.index("screw_speed_rpm")]
    before = np.interp(was.time_s[100] - 0.01, log.time_s, speed)
    assert before == 0.0
    assert np.interp(was.time_s[100], log.time_s, speed) == 1000.0
    row = np.flatnonzero(np.isin(log.time_s, was.time_s, invert=True))
    assert np.isnan(log.values[row, log.channels.index("t2_degC")]).all()


def test_all_problems_at_once(tmp_path):
    path = written(tmp_path / "log.csv", truth())
    lines = path.read_text().split("\n")
    for at in (3, 7, 20):
        lines[at] = lines[at].replace(",", ",broken", 1)
    lines[11] = lines[11] + ",1"
    path.write_text("\n".join(lines))
    with pytest.raises(LogError) as caught:
        read(path)
    message = str(caught.value)
    assert [f"line {n}" in message for n in (4, 8, 12, 21)] == [True] * 4, message


def test_more_than_ten_problems_are_not_all_listed(tmp_path):
    was = truth()
    was.time_s[20:32] = was.time_s[19]
    path = written(tmp_path / "log.csv", was)
    with pytest.raises(LogError, match="12 problems") as caught:
        read(path)
    assert str(caught.value).count("repeats") == 10
    assert "and 2 more" in str(caught.value)
