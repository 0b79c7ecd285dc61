import math
import time

import pytest

from drivers import open_driver
from drivers.settings import PlayerSettings
from observer.errors import LogError
from tests.drivers.harness import running
from tests.patience import eventually


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,t1_degC,n_rpm\n100.0,20.0,0\n100.1,,10\n100.2,22.0,20\n100.3,23.0,30\n")
    return path


async def test_rows_come_in_the_rhythm_of_their_times_and_then_the_end_is_said(log):
    driver = open_driver("log", PlayerSettings(kind="player", path=log))
    assert driver.channels == ("t1_degC", "n_rpm")
    assert driver.period_s == pytest.approx(0.1)
    start_s = time.time()
    async with running(driver) as player:
        await player.until(lambda r: r.values["n_rpm"] == 30.0)
        rows = list(player.readings)
        end = await player.until(lambda r: "n_rpm" in r.faults)
    assert [r.values["n_rpm"] for r in rows] == [0.0, 10.0, 20.0, 30.0]
    assert rows[1].faults == {"t1_degC": "missing"}
    assert math.isnan(rows[1].values["t1_degC"])
    for i, row in enumerate(rows):  # never early; late by what a busy machine takes
        assert row.time_s - start_s >= 0.1 * i - 1e-3
    assert end.faults == {"t1_degC": "end_of_log", "n_rpm": "end_of_log"}


async def test_a_faster_speed_and_a_choice_of_channels(log):
    driver = open_driver("log", PlayerSettings(kind="player", path=log, speed=10, channels=("n_rpm",)))
    assert driver.period_s == pytest.approx(0.01)
    async with running(driver) as player:
        await player.until(lambda r: r.values == {"n_rpm": 30.0})


async def test_rows_are_due_by_the_injected_clock(log):
    """A clock that stands still plays the first row and no other."""
    driver = open_driver("log", PlayerSettings(kind="player", path=log))
    asked = []
    async with running(driver, now=lambda: asked.append("the time") or 7.0) as player:
        await player.until(lambda r: r.time_s == 7.0)
        before = len(asked)
        await eventually(lambda: len(asked) > before + 3)
        assert len(player.readings) == 1


def test_a_column_the_log_has_not_is_named(log):
    with pytest.raises(LogError, match='no column "x_m"; the log has t1_degC, n_rpm'):
        open_driver("log", PlayerSettings(kind="player", path=log, channels=("x_m",)))
