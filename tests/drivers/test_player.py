import asyncio
import math
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.player import PlayerSettings
from observer.errors import LogError
from tests.drivers.harness import running
from tests.patience import eventually


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,t1_degC,n_rpm\n100.0,20.0,0\n100.1,,10\n100.2,22.0,20\n100.3,23.0,30\n")
    return path


async def test_rows_come_in_the_rhythm_of_their_times_and_then_the_end_is_said(log):
    driver = PlayerSettings(kind="player", path=log).open("log")
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


async def test_a_choice_of_channels(log):
    driver = PlayerSettings(kind="player", path=log, channels=("n_rpm",)).open("log")
    async with running(driver) as player:
        await player.until(lambda r: r.values == {"n_rpm": 30.0})


async def test_rows_handed_on_late_have_the_times_at_which_they_were_due(log):
    driver = PlayerSettings(kind="player", path=log).open("log")
    async with running(driver, time.monotonic) as player:
        await player.until(lambda r: r.values["n_rpm"] == 0.0)
        time.sleep(0.5)  # the event loop has something else to do
        await player.until(lambda r: r.values["n_rpm"] == 30.0)
        times = [r.time_s for r in player.readings if "n_rpm" not in r.faults]
    assert [t - times[0] for t in times] == pytest.approx([0.0, 0.1, 0.2, 0.3])


async def test_a_log_whose_rows_are_all_due_leaves_others_their_turn(tmp_path):
    path = tmp_path / "dense.csv"
    path.write_text("time_s,n_rpm\n" + "".join(f"{1e-7 * k:.7f},1\n" for k in range(5_000)))
    driver = PlayerSettings(kind="player", path=path).open("log")
    turns = 0
    async with running(driver) as player:
        while not any(r.faults for r in player.readings):
            await asyncio.sleep(0)
            turns += 1
    assert turns > 2_500


@pytest.mark.parametrize("speed", [2.0, 0.5, 0.0, -1.0])
def test_another_speed_is_rejected_because_heat_does_not_follow_it(log, speed):
    with pytest.raises(ValidationError, match=rf"speed = {speed:g} would present .*`observer replay`"):
        PlayerSettings(kind="player", path=log, speed=speed)


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet", ".txt"])
@given(
    content=st.binary(max_size=200)
    | st.lists(st.sampled_from(["time_s", "t1_degC", "0", "1", "1e400", "-1", "x", ",", "\n", '"', ";"])).map(
        lambda words: "".join(words).encode()
    )
)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_file_is_played_or_rejected_in_one_sentence(tmp_path, suffix, content):
    path = tmp_path / f"any{suffix}"
    path.write_bytes(content)
    refusal = str(path)
    try:
        PlayerSettings(kind="player", path=path).open("log")
    except LogError as error:
        refusal = str(error)
    assert str(path) in refusal
    assert "\n" not in refusal


async def test_rows_are_due_by_the_injected_clock(log):
    """A clock that stands still plays the first row and no other."""
    driver = PlayerSettings(kind="player", path=log).open("log")
    asked = []
    async with running(driver, now=lambda: asked.append("the time") or 7.0) as player:
        await player.until(lambda r: r.time_s == 7.0)
        before = len(asked)
        await eventually(lambda: len(asked) > before + 3)
        assert len(player.readings) == 1


def test_a_column_the_log_has_not_is_named(log):
    with pytest.raises(LogError, match='no column "x_m"; the log has t1_degC, n_rpm'):
        PlayerSettings(kind="player", path=log, channels=("x_m",)).open("log")
