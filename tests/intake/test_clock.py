"""What is doubtful about a clock is asked: change of the clocks, zones, numbers without a unit, months."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

import observer
from observer.errors import LogError
from observer.files.logs import read_log
from observer.intake.reading import read_channels
from tests.intake.machine import START, Truth, assert_is, configured, truth
from tests.intake.rod import import_file

BERLIN = ZoneInfo("Europe/Berlin")
AUTUMN, SPRING = datetime(2026, 10, 25, 0, 30, tzinfo=UTC), datetime(2026, 3, 29, 0, 30, tzinfo=UTC)
START_MIN = START.timestamp() / 60.0
NAMES = "t1 [degC],t2 [degC],nut position [m],screw speed [rpm],ambient [degC]"


def night(begin: datetime) -> Truth:
    """An hour of rows half a minute apart, in which Berlin's clocks are changed."""
    was = truth(120, 30.0)
    return replace(was, time_s=was.time_s - was.time_s[0] + begin.timestamp())


def written(path: Path, was: Truth, time: Callable[[datetime], str], name: str = "time") -> Path:
    """A log whose first column is the time as somebody writes it."""
    values = zip(
        was.t1_degC, was.t2_degC, was.nut_position_m, was.screw_speed_rpm, was.ambient_degC, strict=True
    )
    lines = [f"{name},{NAMES}"]
    lines += [",".join((time(at), *map(str, row))) for at, row in zip(was.moments(), values, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


def questions(path: Path, **given: str) -> str:
    """What `observer import` asks where nobody can answer."""
    with pytest.raises(LogError) as caught:
        import_file(path, configured(path.parent), **given).write(path.with_suffix(".parquet"))
    return str(caught.value)


def imported(path: Path, **given: str):
    """The log of a file about which nothing is left to ask."""
    out = path.with_suffix(".parquet")
    import_file(path, configured(path.parent), **given).write(out)
    return read_log(out)


@pytest.mark.parametrize(("begin", "said"), [(AUTUMN, "goes back by"), (SPRING, "goes forward by an hour")])
def test_a_change_of_the_clocks_is_asked_about_and_undone_by_the_zone(tmp_path, begin, said):
    was = night(begin)
    path = written(tmp_path / "log.csv", was, lambda at: f"{at.astimezone(BERLIN):%Y-%m-%d %H:%M:%S}")
    asked = questions(path)
    assert said in asked
    assert "daylight saving time" in asked
    assert "[log] timezone" in asked
    assert_is(imported(path, timezone="Europe/Berlin"), was)


def test_cells_that_name_their_zone_need_no_other(tmp_path):
    was = night(AUTUMN)  # the first half of the rows says +02:00, the second +01:00
    path = written(tmp_path / "log.csv", was, lambda at: at.astimezone(BERLIN).isoformat())
    assert_is(imported(path), was)


@pytest.mark.parametrize(("unit", "in_s"), [("ms", 1e-3), ("s", 1.0)])
def test_numbers_without_a_unit_are_asked_about_where_they_may_not_be_seconds(tmp_path, unit, in_s):
    was = truth(120, 0.05 if unit == "ms" else 30.0)
    begin_s = was.time_s[0]
    path = written(tmp_path / "log.csv", was, lambda at: f"{(at.timestamp() - begin_s) / in_s:.6f}", "t")
    said = questions(path)
    assert "[log] time_format" in said
    assert '"s", "ms", "min"?' in said
    assert_is(imported(path, time_format=unit), was, since_1970=False)


def test_a_number_that_says_its_unit_is_not_asked_about(tmp_path):
    was = truth(120, 300.0)
    begin_s = was.time_s[0]
    path = written(tmp_path / "log.csv", was, lambda at: f"{(at.timestamp() - begin_s) / 60:.6f}", "t [min]")
    assert_is(imported(path), was, since_1970=False)


def test_what_a_clock_was_taken_for_is_shown(tmp_path):
    was = truth()
    begin_s = was.time_s[0]
    path = written(tmp_path / "log.csv", was, lambda at: f"{at.timestamp() - begin_s:.1f}", "t")
    found = import_file(path, configured(tmp_path))
    assert found.shown[0] == ("time", "t", "s, assumed", "0.000", "1.500", "3.000", "4.500")


@pytest.mark.parametrize(
    ("given", "says"),
    [({"timezone": "Berlin"}, "--timezone: 'Berlin' is no"), ({"time_format": "minutes"}, "--time-format: ")],
)
def test_an_invalid_option_is_named(tmp_path, given, says):
    path = written(tmp_path / "log.csv", truth(), lambda at: at.isoformat())
    assert questions(path, **given).startswith(says)


def test_a_date_whose_month_may_be_its_day_is_asked_about(tmp_path):
    was = truth()
    early = replace(
        was,
        time_s=was.time_s
        + (datetime(2026, 4, 3, tzinfo=UTC) - datetime(2026, 11, 25, tzinfo=UTC)).total_seconds(),
    )
    path = written(
        tmp_path / "log.csv", early, lambda at: f"{at:%m/%d/%Y %H:%M:%S}.{at.microsecond // 100000}"
    )
    assert "read with the day first" in questions(path)
    assert_is(imported(path, time_format="%m/%d/%Y %H:%M:%S.%f"), early)


def test_a_day_beyond_the_twelfth_leaves_no_doubt(tmp_path):
    was = truth()
    path = written(tmp_path / "log.csv", was, lambda at: f"{at:%m/%d/%Y %H:%M:%S}.{at.microsecond // 100000}")
    assert_is(imported(path), was)


def test_a_clock_without_a_date_continues_over_midnight(tmp_path):
    was = truth()
    late = replace(was, time_s=was.time_s + timedelta(hours=15, minutes=57).total_seconds())
    path = written(tmp_path / "log.csv", late, lambda at: f"{at:%H:%M:%S}.{at.microsecond // 100000}")
    log = imported(path)
    assert log.time_s[-1] - log.time_s[0] == pytest.approx(late.time_s[-1] - late.time_s[0])


def test_decimal_commas_between_separating_commas_are_rejected(tmp_path):
    was = truth()
    path = written(tmp_path / "log.csv", was, lambda at: at.isoformat())
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(row.replace(".", ",") for row in rows)]))
    assert "comma" in questions(path)


@pytest.mark.parametrize("name", ["min", "Minuten", "t [min]", "time_min", "Zeit (min)"])
def test_minutes_by_their_name_are_minutes(tmp_path, name):
    was = truth(60, 60.0)
    minute = written(tmp_path / "log.csv", was, lambda at: f"{at.timestamp() / 60.0 - START_MIN:.6f}", name)
    log = observer.read_log(minute)
    assert log.time_s == pytest.approx(was.time_s - 60.0 * START_MIN, abs=1e-3)
    assert log.doubts == ()
    assert imported(minute).time_s[1] - imported(minute).time_s[0] == pytest.approx(60.0, abs=1e-3)


def test_a_log_without_a_machine_has_the_columns_of_its_file_and_says_what_it_assumes(tmp_path):
    was = truth(60, 1.0)
    path = written(tmp_path / "log.csv", was, lambda at: f"{at.timestamp() - 60.0 * START_MIN:.3f}")
    log = observer.read_log(path)
    assert log.channels == tuple(NAMES.split(","))
    assert log["screw speed [rpm]"].tolist() == was.screw_speed_rpm.tolist()
    assert log.doubts == ("time has no unit and was taken for seconds",)
    # a machine that reads the same file is as sure, and no surer
    assert read_channels(path, configured(tmp_path)).doubts == log.doubts
    far = written(tmp_path / "far.csv", was, lambda at: f"{60.0 * (at.timestamp() - 60.0 * START_MIN):.3f}")
    with pytest.raises(LogError, match=r"time_format: time has no unit and its rows are 60 apart"):
        observer.read_log(far)


def test_a_german_spreadsheet_is_read_without_a_machine(tmp_path):
    path = tmp_path / "halle.csv"
    rows = [f"25.11.2026 08:00:{i:02d};{20 + i},5;{1000 * (i > 3)};ok" for i in range(9)]
    path.write_text("\n".join(["Datum;Temp [°C];Drehzahl [1/min];Zustand", *rows]) + "\n", encoding="cp1252")
    log = observer.read_log(path)
    assert log.channels == ("Temp [°C]", "Drehzahl [1/min]")
    assert log["Temp [°C]"].tolist() == [20.5 + i for i in range(9)]
    assert (log.time_s[-1] - log.time_s[0]) == 8.0
    path.write_text("nothing;here\na;b\nc;d\n", encoding="utf-8")
    with pytest.raises(LogError, match="no recognisable columns of numbers and times"):
        observer.read_log(path)
