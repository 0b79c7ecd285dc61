"""Files as other programs write them become the log that they hold, without a word about their dress."""

from __future__ import annotations

import gzip
from datetime import timedelta

import can
import numpy as np
import openpyxl
import pytest

from observer.align.log_times import intervals_s
from observer.errors import LogError
from observer.files.logs import read_log
from observer.intake.mapped import read_foreign
from observer.intake.readers import holds_signals
from observer.intake.reading import read_channels
from observer.process.memory import import_mf4
from tests.intake.machine import NAMED, assert_is, configured, read, truth
from tests.intake.writers import (
    GERMAN,
    NAMES,
    columns,
    german,
    labview,
    measurement,
    mtconnect,
    of_feather,
    of_libreoffice,
    of_pandas,
    of_parquet,
    recorder,
    stamped,
    waveforms,
    workbook,
)

UTC_ZONE = '\n[log]\ntimezone = "UTC"'


@pytest.mark.parametrize(
    ("suffix", "write", "table"),
    [
        (".xlsx", workbook, UTC_ZONE),
        (".ods", of_libreoffice, UTC_ZONE),
        (".parquet", of_parquet, ""),
        (".parquet", of_pandas, ""),
        (".feather", of_feather, ""),
        (".mf4", measurement("4.10"), ""),
        (".mdf", measurement("3.30"), ""),
        (".dat", measurement("3.30"), ""),
        (".tdms", waveforms, ""),
        (".tdms", stamped, ""),
        (".lvm", labview, UTC_ZONE),
        (".csv", recorder, ""),
    ],
)
def test_a_file_of_another_program_is_read_as_it_is(tmp_path, suffix, write, table):
    # the recorder writes whole seconds
    was, path = truth(step_s=2.0 if write is recorder else 1.5), tmp_path / f"run{suffix}"
    write(path, was)
    assert_is(read(path, table), was, apart=6e-5 if write is recorder else 1e-6)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8-sig", "utf-16", "utf-8", "gz"])
@pytest.mark.parametrize("preamble", ["", "Maschine;DMU 50\r\nProgramm;%_N_WARM_MPF\r\n\r\n"])
def test_a_german_control_is_read_in_any_encoding(tmp_path, encoding, preamble):
    was, path = truth(), tmp_path / ("lauf.csv.gz" if encoding == "gz" else "lauf.csv")
    text = german(was, preamble)
    path.write_bytes(gzip.compress(text.encode("cp1252")) if encoding == "gz" else text.encode(encoding))
    assert_is(read(path, GERMAN), was, apart=6e-6)


@pytest.mark.parametrize(
    ("stamp", "head", "since_1970"),
    [
        (lambda m, s: m.isoformat(), "Timestamp", True),
        (lambda m, s: (m + timedelta(hours=2)).replace(tzinfo=None).isoformat() + "+02:00", "Time", True),
        (lambda m, s: f"{m:%Y-%m-%dT%H:%M:%S}.{m.microsecond // 1000:03d}Z", "Timestamp", True),
        (lambda m, s: f"{m:%m/%d/%Y %I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}", "Timestamp", True),
        (lambda m, s: f"{m:%d-%b-%Y %H:%M:%S}.{m.microsecond // 1000:03d}", "Timestamp", True),
        (lambda m, s: f"{m:%Y%m%d %H%M%S}.{m.microsecond // 1000:03d}", "Timestamp", True),
        (lambda m, s: f"{s / 86400.0 + 25569:.9f}", "Timestamp", True),
        (lambda m, s: f"{1000 * s:.0f}", "Timestamp", True),
        (lambda m, s: f"{1e9 * s:.0f}", "Timestamp", True),
        (lambda m, s: f"{1000 * (s - truth().time_s[0]):.0f}", "t [ms]", False),
    ],
)
def test_times_and_units_are_read_as_people_write_them(tmp_path, stamp, head, since_1970):
    was, path = truth(), tmp_path / "log.csv"
    rows = [f"{head},t1 [degF],t2 [degF],nut position [mm],screw speed [1/s],ambient [K]"]
    for m, s, a, b, x, n, c in zip(was.moments(), was.time_s, *was.values(), strict=True):
        cells = (1.8 * a + 32.0, 1.8 * b + 32.0, 1000.0 * x, n / 60.0, c + 273.15)
        rows.append(",".join([stamp(m, s), *(f"{cell:.6f}" for cell in cells)]))
    path.write_text("\n".join(rows), encoding="utf-8")
    assert_is(read(path), was, since_1970=since_1970, apart=1e-4)


@pytest.mark.parametrize(
    ("suffix", "write"), [(".xlsx", workbook), (".mf4", measurement("4.10")), (".tdms", waveforms)]
)
def test_a_cut_file_of_another_program_is_rejected_in_one_sentence(tmp_path, suffix, write):
    path = tmp_path / f"cut{suffix}"
    write(path, truth())
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(LogError, match="cut") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_signals_of_mdf_are_distinguished_from_bus_frames(tmp_path):
    measurement("4.10")(tmp_path / "signals.mf4", truth())
    import_mf4()
    with can.MF4Writer(tmp_path / "bus.mf4") as writer:
        frame = can.Message(timestamp=1.0, arbitration_id=0x12, data=[1, 2], is_extended_id=False)
        writer.on_message_received(frame)
    assert holds_signals(tmp_path / "signals.mf4")
    assert not holds_signals(tmp_path / "bus.mf4")


# ---- several rates, several files, one signal a row ----


def sheets_of_two_rates(folder, was):
    """A sheet of the axis with each row, and one of temperatures with every fourth."""
    book = openpyxl.Workbook()
    fast, slow = book.active, book.create_sheet("Temperaturen")
    fast.title = "Achse"
    fast.append(["Time", *NAMES[2:4]])
    slow.append(["Time", *NAMES[:2], NAMES[4]])
    for i, (moment, *cells) in enumerate(zip(was.moments(), *columns(was), strict=True)):
        fast.append([moment.replace(tzinfo=None), *map(float, cells[2:4])])
        if i % 4 == 0:
            slow.append([moment.replace(tzinfo=None), *map(float, (*cells[:2], cells[4]))])
    book.save(folder / "run.xlsx")
    return [folder / "run.xlsx"]


def files_of_two_rates(folder, was):
    """The same as two files of text."""
    fast, slow = folder / "axis.csv", folder / "logger.csv"
    rows = zip(was.moments(), was.nut_position_m, was.screw_speed_rpm, strict=True)
    text = "".join(f"{m.isoformat()},{x},{n}\n" for m, x, n in rows)
    fast.write_text("time,nut_position_m,screw_speed_rpm\n" + text)
    some = list(zip(was.moments(), was.t1_degC, was.t2_degC, was.ambient_degC, strict=True))[::4]
    text = "".join(f"{m:%d.%m.%Y %H:%M:%S};{a};{b};{c}\n" for m, a, b, c in some)
    slow.write_text("Zeit;t1 [°C];t2 [°C];ambient [°C]\n" + text, encoding="utf-8")
    return [fast, slow]


@pytest.mark.parametrize("write", [sheets_of_two_rates, files_of_two_rates])
def test_sheets_and_files_of_two_rates_are_joined_on_their_clocks(tmp_path, write):
    was, config = truth(), configured(tmp_path, UTC_ZONE)
    log = read_foreign(write(tmp_path, was), config)
    assert log.joined
    np.testing.assert_allclose(log.time_s, was.time_s, atol=1e-4)
    unknown_s = np.full(len(config.channels), np.nan)
    by_name = dict(zip(config.channels, intervals_s(log, config.channels, unknown_s), strict=True))
    assert by_name["t1_degC"] == pytest.approx(6.0, abs=1e-3)
    assert by_name["nut_position_m"] == pytest.approx(1.5, abs=1e-3)
    np.testing.assert_allclose(log["t1_degC"][::4], was.t1_degC[::4])
    assert np.isnan(log["t1_degC"][1::4]).all()
    assert np.isfinite(log["nut_position_m"]).all()


def test_files_that_count_from_different_beginnings_are_not_joined(tmp_path):
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    rows = "".join(f"{m.isoformat()},0.5,1000\n" for m in truth().moments())
    one.write_text("time,nut_position_m,screw_speed_rpm\n" + rows)
    rows = "".join(f"{1.5 * i},22.5,22,21\n" for i in range(240))
    other.write_text("t [s],t1_degC,t2_degC,ambient_degC\n" + rows)
    with pytest.raises(LogError, match=r"other\.csv counts from its own beginning"):
        read_foreign([one, other], configured(tmp_path))


COLUMNS = """
[log.columns]
nut_position_m = "Zpos"
t1_degC = "Temp1"
screw_speed_rpm = "S1"
t2_degC = "Temp2"
ambient_degC = "Amb"
"""


@pytest.mark.parametrize("table", ['\n[log]\nlong = { name = "name", value = "value" }\n', COLUMNS])
def test_one_signal_a_row_is_read_by_the_names_of_the_signals(tmp_path, table):
    was, path = truth(), tmp_path / "agent.csv"
    path.write_text(mtconnect(was), encoding="utf-8")
    log = read(path, table)
    assert log.joined
    np.testing.assert_allclose(log.time_s, was.time_s, atol=1e-5)
    is_read = np.arange(len(was.time_s)) != 6
    np.testing.assert_allclose(log["t1_degC"][is_read], was.t1_degC[is_read])
    assert np.isnan(log["t1_degC"][6])
    np.testing.assert_allclose(log["screw_speed_rpm"][[10, 11, 12]], was.screw_speed_rpm[[9, 9, 12]])
    assert any("UNAVAILABLE" in words.text for words in log.words)


def test_one_signal_a_row_is_recognised_although_its_time_is_named_as_in_our_logs(tmp_path):
    was, path = truth(), tmp_path / "long.csv"
    rows = ["time_s,signal,value"]
    for time_s, *cells in zip(was.time_s.tolist(), *was.values(), strict=True):
        rows += [f"{time_s!r},{name},{cell}" for name, cell in zip(NAMED, cells, strict=True)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    log = read(path)
    for name in NAMED:
        np.testing.assert_array_equal(log[name], getattr(was, name))


# ---- our own form ----

FOREIGN = """
[log]
separator = ";"
decimal = ","
timezone = "Europe/Berlin"
"""


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".parquet"])
@pytest.mark.parametrize("table", ["", FOREIGN])
def test_a_log_in_our_own_form_keeps_its_bits_whatever_is_configured_of_others(tmp_path, suffix, table):
    path = truth().write(tmp_path / f"log{suffix}")
    config = configured(tmp_path, table)
    log, plain = read_channels(path, config), read_log(path, config.channels)
    assert log.channels == plain.channels
    np.testing.assert_array_equal(log.time_s, plain.time_s)
    np.testing.assert_array_equal(log.values, plain.values)
    assert not log.joined


def test_a_renamed_column_of_our_form_is_converted(tmp_path):
    was = truth()
    path = was.write(tmp_path / "log.csv", motor_degF=1.8 * was.t1_degC + 32.0)
    log = read(path, '\n[log.columns]\nt1_degC = { column = "motor_degF", unit = "degF" }\n')
    np.testing.assert_allclose(log["t1_degC"], was.t1_degC, atol=1e-9)


def test_inputs_that_hold_change_at_their_row(tmp_path):
    was = truth()
    speed_rpm = np.where(np.arange(len(was.time_s)) < 100, 0.0, 1000.0)
    log = read(was.write(tmp_path / "log.csv", screw_speed_rpm=speed_rpm), "\n[log]\nhold = true\n")
    at_s = was.time_s[100] + np.array([-0.01, 0.0])
    assert np.interp(at_s, log.time_s, log["screw_speed_rpm"]).tolist() == [0.0, 1000.0]
    added = np.isin(log.time_s, was.time_s, invert=True)
    assert np.isnan(log["t2_degC"][added]).all()


def test_all_problems_of_a_log_are_listed_at_once(tmp_path):
    path = truth().write(tmp_path / "log.csv")
    lines = path.read_text().split("\n")
    for at in (3, 7, 20):
        lines[at] = lines[at].replace(",", ",broken", 1)
    lines[11] += ",1"
    path.write_text("\n".join(lines))
    with pytest.raises(LogError) as caught:
        read(path)
    assert [n for n in (4, 8, 12, 21) if f"line {n}" not in str(caught.value)] == []


def test_ten_of_more_problems_are_listed(tmp_path):
    was = truth()
    was.time_s[20:32] = was.time_s[19]
    with pytest.raises(LogError, match="12 problems") as caught:
        read(was.write(tmp_path / "log.csv"))
    assert str(caught.value).count("repeats") == 10
    assert "and 2 more" in str(caught.value)
