"""Text as controls, recorders and spreadsheets write it becomes a log without a word about its dress."""

from __future__ import annotations

import gzip
from datetime import timedelta

import numpy as np
import pytest

from tests.intake.machine import Truth, assert_is, read, truth

COLUMNS = """
[log.columns]
t1_degC = "{}"
t2_degC = "{}"
nut_position_m = "{}"
screw_speed_rpm = "{}"
ambient_degC = "{}"
"""


def german(was: Truth, preamble: str = "") -> str:
    """As a German control writes it: date and time in two columns, decimal commas, mm and 1/min."""
    lines = [preamble + "Datum;Uhrzeit;Temp. Lager [°C];Temp. Mutter [°C];X (mm);Drehzahl [1/min];Halle [°C]"]
    for i, moment in enumerate(was.moments()):
        cells = (was.t1_degC[i], was.t2_degC[i], 1000.0 * was.nut_position_m[i], was.screw_speed_rpm[i])
        numbers = [f"{cell:.2f}".replace(".", ",") for cell in (*cells, was.ambient_degC[i])]
        local = moment + timedelta(hours=1)
        lines.append(
            ";".join([f"{local:%d.%m.%Y}", f"{local:%H:%M:%S},{local.microsecond // 100000}", *numbers])
        )
    return "\r\n".join(lines) + "\r\n"


GERMAN = '\n[log]\ntimezone = "Europe/Berlin"' + COLUMNS.format(
    "Temp. Lager", "Temp. Mutter", "X", "Drehzahl", "Halle"
)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8-sig", "utf-16", "utf-8"])
@pytest.mark.parametrize("preamble", ["", "Maschine;DMU 50\r\nProgramm;%_N_WARM_MPF\r\n\r\n"])
def test_german_control(tmp_path, encoding, preamble):
    was, path = truth(), tmp_path / "lauf.csv"
    path.write_bytes(german(was, preamble).encode(encoding))
    assert_is(read(path, GERMAN), was, apart=6e-6)


def test_compressed_text_is_read_as_it_is(tmp_path):
    was, path = truth(), tmp_path / "lauf.csv.gz"
    path.write_bytes(gzip.compress(german(was).encode("cp1252")))
    assert_is(read(path, GERMAN), was, apart=6e-6)


def test_recorder_with_a_preamble_and_a_row_of_units(tmp_path):
    """As Graphtec's and Yokogawa's recorders export: much above the table, names, units, a number a row."""
    was, path = truth(), tmp_path / "GL840.csv"
    lines = ["Vendor,GRAPHTEC Corporation", "Model,GL840", "Sampling interval,1.5s", '"Amp settings"']
    lines += ["CH,Signal name,Input,Range", "CH1,t1,TEMP,TC_K", "CH2,t2,TEMP,TC_K", "", "Data"]
    lines += ["Number,Date&Time,ms,t1,t2,nut_position,screw_speed,ambient"]
    lines += ["NO.,Time,ms,degC,degC,mm,rpm,degC"]
    for i, m in enumerate(was.moments()):
        x_mm = 1000.0 * was.nut_position_m[i]
        lines.append(
            f"{i + 1},{m:%Y/%m/%d %H:%M:%S},{m.microsecond // 1000},"
            f"+{was.t1_degC[i]:.2f},+{was.t2_degC[i]:.2f},{x_mm:.1f},{was.screw_speed_rpm[i]:.0f},{was.ambient_degC[i]:.2f}"
        )
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    log = read(path)
    np.testing.assert_allclose(log.time_s, was.time_s, atol=0.51)  # it writes whole seconds
    np.testing.assert_allclose(
        log.values[:, log.channels.index("nut_position_m")], was.nut_position_m, atol=6e-5
    )


@pytest.mark.parametrize(
    ("written", "since_1970"),
    [
        (lambda m, s: m.isoformat(), True),
        (lambda m, s: (m + timedelta(hours=2)).replace(tzinfo=None).isoformat() + "+02:00", True),
        (lambda m, s: f"{m:%Y-%m-%dT%H:%M:%S}.{m.microsecond // 1000:03d}Z", True),
        (lambda m, s: f"{m:%m/%d/%Y %I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}", True),
        (lambda m, s: f"{m:%d-%b-%Y %H:%M:%S}.{m.microsecond // 1000:03d}", True),
        (lambda m, s: f"{m:%Y%m%d %H%M%S}.{m.microsecond // 1000:03d}", True),
        (lambda m, s: f"{s / 86400.0 + 25569:.9f}", True),
        (lambda m, s: f"{1000 * s:.0f}", True),
        (lambda m, s: f"{1e9 * s:.0f}", True),
    ],
)
def test_times_as_people_write_them(tmp_path, written, since_1970):
    was, path = truth(), tmp_path / "log.csv"
    rows = ["Timestamp,t1 [degF],t2 [degF],nut position [mm],screw speed [1/s],ambient [K]"]
    for i, m in enumerate(was.moments()):
        cells = (1.8 * was.t1_degC[i] + 32.0, 1.8 * was.t2_degC[i] + 32.0, 1000.0 * was.nut_position_m[i])
        more = (was.screw_speed_rpm[i] / 60.0, was.ambient_degC[i] + 273.15)
        rows.append(",".join([written(m, was.time_s[i]), *(f"{cell:.6f}" for cell in (*cells, *more))]))
    path.write_text("\n".join(rows), encoding="utf-8")
    assert_is(read(path), was, since_1970=since_1970, apart=1e-4)


def test_a_clock_in_milliseconds_counts_from_its_beginning(tmp_path):
    was, path = truth(), tmp_path / "log.tsv"
    rows = ["t [ms]\tt1_degC\tt2_degC\tnut_position_m\tscrew_speed_rpm\tambient_degC"]
    rows += [
        f"{1000 * (s - was.time_s[0]):.0f}\t{a}\t{b}\t{x}\t{n}\t{c}"
        for s, a, b, x, n, c in zip(
            was.time_s, was.t1_degC, was.t2_degC, was.nut_position_m, was.screw_speed_rpm, was.ambient_degC,
            strict=True,
        )
    ]  # fmt: skip
    path.write_text("\n".join(rows), encoding="utf-8")
    assert_is(read(path), was, since_1970=False)
