"""Clocks, units and rows as recorders of several makers and languages write them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import observer
from observer.errors import LogError
from observer.files.logs import read_log
from observer.intake.reading import read_channels
from observer.library.given import recorded
from tests.intake.rod import import_file, rod

START = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)
START_S = START.timestamp()
T1 = {"t1_degC": "T1"}


def written(path, lines, encoding="utf-8"):
    path.write_bytes(("\n".join(lines) + "\n").encode(encoding))
    return path


def stamps(form: str, rows: int = 40, step_s: float = 10.0) -> list[str]:
    return [(START + timedelta(seconds=step_s * i)).strftime(form) for i in range(rows)]


HOBO = ['"Plot Title: rig"', '"#","Date Time, GMT-05:00","Temp, °F (LGR S/N: 20, SEN S/N: 30, LBL: T1)"']
HOBO_T1 = {"t1_degC": "Temp, °F (LGR S/N: 20, SEN S/N: 30, LBL: T1)"}
BENCHLINK = ["Scan Control:", "Start Action:,Immediately", "", "Scan,Time,101 <T1> (C),Alarm 101"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(
    ("header", "row", "form", "columns", "first_s", "first_degC"),
    [
        (HOBO, "{i},{t},70.0", "%m/%d/%y %I:%M:%S %p", HOBO_T1, 5 * 3600, 21.1111),
        (BENCHLINK, "{i},{t},21.5,0", "%m/%d/%Y %H:%M:%S:%f", {"t1_degC": "101 <T1>"}, 0, 21.5),
        (["Zeitpunkt;T1 [°C];Nr"], "{t};21,5;{i}", "%d.%m.%Y %H:%M:%S", T1, 0, 21.5),
        (["Zeit (MEZ)\tT1 in °C"], "{t}\t21,5", "%d.%m.%Y %H:%M:%S", T1, -3600, 21.5),
        (["Horodatage;T1 (°C)"], "{t};21,5", "%d mars %Y %H:%M:%S", T1, 0, 21.5),
        (["time (UTC),T1 [K]"], "{t},294.65", "%Y-%m-%d %H:%M:%S", T1, 0, 21.5),
        (["Time;T1"], "{t};21,5 °C", "%d.%m.%Y %H:%M:%S", T1, 0, 21.5),
        (["Time,T1"], "{t},70.7 °F", "%Y-%m-%d %H:%M:%S", T1, 0, 21.5),
        (["Datum;Uhrzeit;T1 [Grad C]"], "{t};21,5", "%d.%m.%Y;%H:%M:%S", T1, 0, 21.5),
    ],
)  # fmt: skip
def test_dates_and_numbers_of_several_languages(
    tmp_path, encoding, header, row, form, columns, first_s, first_degC
):
    rows = [row.format(i=i, t=t) for i, t in enumerate(stamps(form))]
    path = written(tmp_path / "log.csv", [*header, *rows], encoding)
    log = recorded(path, rod(tmp_path, {"time_format": form} if "%f" in form else {}, columns))
    assert len(log) == 40
    assert log.time_s[0] == pytest.approx(START_S + first_s)
    np.testing.assert_allclose(np.diff(log.time_s), 10.0)
    assert log["t1_degC"][0] == pytest.approx(first_degC, abs=1e-3)


@pytest.mark.parametrize(
    ("names", "first", "step"),
    [
        ("Scan", 1, 1), ("Energy [kWh]", 100, 0.5), ("T_air [°C]", 20, 0.01), ("Nr.", 1, 1), ("T", 20, 0.01),
        ("Laufzeit", 100, 10), ("cycle time [s]", 5, 0.1), ("count", 0, 1), ("U [V]", 1, 0.1),
    ],
)  # fmt: skip
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_column_that_only_rises_is_no_clock_and_yes_does_not_make_it_one(
    tmp_path, names, first, step, mark
):
    rows = [f"{first + step * i:.2f}{mark}{21 + (i % 3) / 10}" for i in range(40)]
    path = written(tmp_path / "log.csv", [f"{names}{mark}T1", *rows])
    for read in (
        lambda: observer.read_log(path),
        lambda: recorded(path, rod(tmp_path, {}, T1)),
        lambda: import_file(path, rod(tmp_path, {}, T1)),
    ):
        with pytest.raises(LogError) as caught:
            read()
        assert names in str(caught.value)
        assert "[log] time" in str(caught.value)
        assert "every_s" in str(caught.value)


@pytest.mark.parametrize("unit", ["kWh", "°C", "mm"])
def test_a_column_named_as_the_time_whose_unit_is_none_of_time_is_refused(tmp_path, unit):
    path = written(tmp_path / "log.csv", [f"E [{unit}],T1", *(f"{i},21.5" for i in range(9))])
    with pytest.raises(LogError, match="none of time"):
        recorded(path, rod(tmp_path, {"time": "E"}, T1))


@pytest.mark.parametrize("unit", ["Nord", "foo", "1/10 °C", "x10", "mdegC?"])
@pytest.mark.parametrize("by_name", [True, False])
def test_a_unit_that_is_not_understood_is_asked_about_and_settled_by_the_key(tmp_path, unit, by_name):
    name = "Housing" if by_name else "t1"
    rows = [f"{t},21.5" for t in stamps("%Y-%m-%d %H:%M:%S")]
    path = written(tmp_path / "log.csv", [f"time,{name} [{unit}]", *rows])
    columns = {"t1_degC": name} if by_name else {}
    with pytest.raises(LogError, match="is not understood") as caught:
        recorded(path, rod(tmp_path, {}, columns))
    assert "[log.columns]" in str(caught.value)
    with pytest.raises(LogError, match="is not understood"):
        import_file(path, rod(tmp_path, {}, columns))
    settled = rod(tmp_path, {}, {})
    settled = settled.model_copy(
        update={"log": settled.log.model_validate({"columns": {"t1_degC": {"column": name, "unit": "degF"}}})}
    )
    assert read_channels(path, settled)["t1_degC"][0] == pytest.approx(-5.8333, abs=1e-3)


def test_columns_with_clocks_of_their_own_keep_them(tmp_path):
    rows = [f"{i};{21 + i};{i / 10};{100 + i}" for i in range(60)]
    path = written(tmp_path / "log.csv", ["Time [s];T1 [°C];Time [s];Pos [mm]", *rows])
    log = observer.read_log(path)
    at = np.flatnonzero(np.isfinite(log["Pos [mm]"]))
    assert log.time_s[at[-1]] - log.time_s[at[0]] == pytest.approx(5.9)
    at = np.flatnonzero(np.isfinite(log["T1 [°C]"]))
    assert log.time_s[at[-1]] - log.time_s[at[0]] == pytest.approx(59.0)


def test_line_protocol_gives_each_field_its_own_times(tmp_path):
    ns = int(START_S) * 10**9
    lines = [f"rig,place=front t1={21 + i / 10} {ns + i * 10**9}" for i in range(30)]
    lines[7:7] = [f'rig,place=front state="on",load=7i {ns}']
    log = recorded(written(tmp_path / "log.lp", lines), rod(tmp_path, {}, {"t1_degC": "rig.front.t1"}))
    assert len(log) == 30
    assert log.time_s[0] == START_S
    assert log["t1_degC"][:2].tolist() == [21.0, 21.1]


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet"])
def test_what_was_doubtful_at_an_import_is_said_by_every_command_that_reads_the_log(tmp_path, suffix):
    rows = [f"{i};{'OVLD' if i == 5 else 21.5}" for i in range(40)]
    rows[20] = "20;21;22"
    path, out = written(tmp_path / "log.txt", ["t;T1", *rows]), tmp_path / f"out{suffix}"
    config = rod(tmp_path, {}, T1)
    import_file(path, config).write(out)
    doubts = read_log(out).doubts
    for words in ("t has no unit and was taken for seconds", "line 22 has 3 cells", "1 cell says OVLD"):
        assert any(words in doubt for doubt in doubts), doubts
    assert set(doubts) <= set(observer.Machine(config, b"").replay(out).summary["doubts"])


def test_a_word_in_a_cell_does_not_become_the_header(tmp_path):
    rows = [f"{t};21.5;22.5" for t in stamps("%Y-%m-%d %H:%M:%S")]
    rows[3], rows[30] = "unavailable;unavailable;unavailable", f"{rows[30][:19]};null;null"
    path = written(tmp_path / "log.csv", ["time;T1;T2", *rows])
    log = observer.read_log(path)
    assert log.channels == ("T1", "T2")
    assert len(log) == 39
    assert any("line 5" in doubt for doubt in log.doubts)


def test_a_second_table_with_other_columns_is_refused(tmp_path):
    rows = [f"{t};21.5;22.5" for t in stamps("%Y-%m-%d %H:%M:%S")]
    path = written(tmp_path / "log.csv", ["time;T1;T2", *rows[:20], "time;T2;T1", *rows[20:]])
    with pytest.raises(LogError, match="line 22 names other columns"):
        observer.read_log(path)


def test_a_log_that_begins_in_the_hour_that_comes_twice_is_asked_about(tmp_path):
    rows = [f"25.10.2026 02:{i:02d}:00;21,5" for i in range(40)]
    path = written(tmp_path / "log.csv", ["Zeit;T1", *rows])
    with pytest.raises(LogError, match="came twice in Europe/Berlin"):
        import_file(path, rod(tmp_path, {"timezone": "Europe/Berlin"}, T1)).write(tmp_path / "out.csv")


def test_a_channel_without_a_column_is_not_offered_the_one_that_was_named(tmp_path):
    path = written(tmp_path / "log.csv", ["t [s],T1 [V],T2 [°C]", *(f"{i},1.2,21.5" for i in range(9))])
    with pytest.raises(LogError) as caught:
        import_file(path, rod(tmp_path, {}, T1))
    assert "is in V, which cannot be °C" in str(caught.value)
    assert "one of" not in str(caught.value)
    with pytest.raises(LogError) as caught:
        import_file(path, rod(tmp_path, {}, {"t1_degC": "Lager"}))
    assert 'there is no column "Lager"' in str(caught.value)
    assert '"t [s]"' not in str(caught.value).partition("one of")[2]


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\t{x_columns}
Time_Pref\t{time_pref}
Date\t2026/03/02
Time\t08:00:00
***End_of_Header***\t

Channels\t2
Y_Unit_Label\tdegC\t\tmm
X0\t0\t\t0
Delta_X\t1\t\t0.1
***End_of_Header***\t\t
"""


def test_signals_of_labview_keep_the_times_of_their_own(tmp_path):
    rows = [f"{i}\t{21 + i}\t{i / 10}\t{100 + i}" for i in range(60)]
    head = LVM.format(x_columns="Multi", time_pref="Relative") + "X_Value\tT1\tX_Value\tPos\tComment"
    log = observer.read_log(written(tmp_path / "log.lvm", [head, *rows]))
    at = np.flatnonzero(np.isfinite(log["Pos [mm]"]))
    assert log.time_s[at[-1]] - log.time_s[at[0]] == pytest.approx(5.9, abs=1e-5)
    assert log.time_s[0] == START_S


def test_absolute_times_of_labview_count_from_1904(tmp_path):
    rows = [f"{3855283200 + i}\t{21 + i}\t{100 + i}" for i in range(60)]
    head = LVM.format(x_columns="One", time_pref="Absolute") + "X_Value\tT1\tPos\tComment"
    log = observer.read_log(written(tmp_path / "log.lvm", [head, *rows]))
    assert log.time_s[0] == START_S
