"""Logs, files of other programs and DBC files with damaged bytes are read, or rejected in one sentence."""

from __future__ import annotations

import gzip
import io
import os
import resource
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as pa
import pytest
from pyarrow import parquet

from drivers.can import CanSettings
from drivers.dbc import dbc_problems, load_decoder
from observer.errors import LogError, UserError
from observer.files.logs import Log, read_log
from observer.files.writer import write_log
from tests.hostile.bits import damaged
from tests.hostile.test_wires import MUX_DBC
from tests.intake.machine import read, truth
from tests.intake.writers import (
    labview,
    of_feather,
    of_libreoffice,
    of_parquet,
    quoted_text,
    waveforms,
    workbook,
)
from tests.system.bad_inputs import CHANNELS, rows, text
from tests.system.plant import ROOT

AXIS = ROOT / "drivers" / "simulated" / "axis.dbc"
RECORDING = text(
    [[*rows()[0], "step", "flags"], *([*row, "1", "t1_degC=open_circuit"] for row in rows()[1:])]
)
OWN = {
    "log.csv": text(rows()).encode(),
    "recording.csv": RECORDING.encode(),
    "log.csv.gz": gzip.compress(text(rows()).encode(), mtime=0),
}
OTHERS = {
    "run.tdms": waveforms,
    "run.feather": of_feather,
    "run.parquet": of_parquet,
    "run.lvm": labview,
    "run.xlsx": workbook,
    "run.ods": of_libreoffice,
    "run.txt": quoted_text,
}


def assert_one_sentence(error: UserError) -> None:
    """One sentence, or a list of at most ten of them and how many more there are."""
    first, *listed = str(error).split("\n")
    assert all(line.isprintable() for line in (first, *listed)), (first, listed)
    assert len(listed) != 1
    assert len(listed) <= 11
    assert len(str(error)) < 1500 + 200 * len(listed), str(error)


def assert_sound(log: Log) -> None:
    assert np.isfinite(log.time_s).all()
    assert (np.diff(log.time_s) > 0).all()
    assert log.values.shape == (len(log.time_s), len(log.channels))


def rejected_of_damaged(path, count, seed, use, check=assert_one_sentence):
    """How many damaged copies of a file are rejected in a sentence; no other error may come of one."""
    good, rejected = path.read_bytes(), 0
    for label, data in damaged(good, count, seed):
        path.write_bytes(data)
        try:
            use()
        except UserError as error:
            check(error)
            rejected += 1
        except BaseException as error:
            error.add_note(label)
            raise
    return rejected


@pytest.mark.parametrize("name", OWN)
def test_a_damaged_log_is_read_or_rejected(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(OWN[name])
    assert_sound(read_log(path, CHANNELS))
    assert rejected_of_damaged(path, 150, len(name), lambda: assert_sound(read_log(path, CHANNELS))) > 37


@pytest.mark.parametrize("name", OTHERS)
def test_a_damaged_file_of_another_program_is_read_or_rejected(name, tmp_path):
    path = tmp_path / name
    OTHERS[name](path, truth(rows=24))
    count = 12 if name in ("run.xlsx", "run.ods") else 300  # a workbook is read in a process of its own

    def use():
        read(path, '\n[log]\ntimezone = "UTC"')

    assert rejected_of_damaged(path, count, 7, use, check=str) > count // 20  # a header is quoted as it is


def test_a_changed_byte_of_a_parquet_log_never_becomes_another_value(tmp_path):
    path, measured = tmp_path / "log.parquet", truth()
    write_log(path, measured.time_s, {"t1_degC": measured.t1_degC, "t2_degC": measured.t2_degC})
    whole = read_log(path)

    def use():
        log = read_log(path, ["t1_degC", "t2_degC"])
        np.testing.assert_array_equal(log.time_s, whole.time_s)
        np.testing.assert_array_equal(log.values, whole.values)

    assert rejected_of_damaged(path, 300, 3, use) > 150


@pytest.mark.parametrize(
    ("content", "message", "signal"),
    [(AXIS.read_text(), "AxisStatus", "NutPosition"), (MUX_DBC, "Mux", "One")],
    ids=["axis", "mux"],
)
def test_a_damaged_dbc_is_used_or_rejected(content, message, signal, tmp_path):
    path = tmp_path / "damaged.dbc"
    path.write_text(content)
    bus = {"kind": "can", "interface": "virtual", "channel": "x", "dbc": path}
    channels = {"x_m": {"message": message, "signal": signal}}
    signals = CanSettings.model_validate(bus | {"channels": channels}).signals("axis")
    assert dbc_problems(signals) == []
    assert rejected_of_damaged(path, 150, 5, lambda: load_decoder(signals)) > 37


def test_a_log_that_is_not_a_file_is_rejected(tmp_path):
    pipe, endless = tmp_path / "pipe.csv", tmp_path / "endless.csv"
    os.mkfifo(pipe)
    endless.symlink_to("/dev/zero")
    for path in (pipe, endless):
        with pytest.raises(LogError, match="cannot be read"):
            read_log(path, CHANNELS)


@pytest.fixture
def bounded_memory():
    """Fails an allocation of gigabytes, which would otherwise take the memory of the other tests."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used_bytes = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used_bytes + (3 << 30), before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@cache
def zeros_packed(size_bytes):
    """Compressed zeros, a thousandth of their size."""
    packed = io.BytesIO()
    with gzip.GzipFile(fileobj=packed, mode="wb", compresslevel=1) as file:
        for _ in range(size_bytes >> 20):
            file.write(b"0" * (1 << 20))
    return packed.getvalue()


@pytest.mark.parametrize("name", ["log.csv.gz", "other.txt.gz", "labview.lvm.gz"])
@pytest.mark.usefixtures("bounded_memory")
def test_a_small_file_that_unpacks_to_gigabytes_is_rejected(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(gzip.compress(b"time_s,t1_degC\n0,") + zeros_packed(2 << 30))
    for reader in (read, read_log) if name == "log.csv.gz" else (read,):
        with pytest.raises(LogError, match="split it into shorter logs") as caught:
            reader(path)
        assert_one_sentence(caught.value)


def far_cell(path, cell):
    book = openpyxl.Workbook()
    book.active["A1"], book.active[cell] = "Time", 1.0
    book.save(path)


def workbook_of_gigabytes(path, _):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as bomb:
        packed = io.BytesIO()
        workbook(packed, truth(rows=24))
        good = zipfile.ZipFile(packed)
        for name in good.namelist():
            content = good.read(name)
            text_at = content.find(b"Time") if name == "xl/worksheets/sheet2.xml" else 0
            with bomb.open(name, "w", force_zip64=True) as part:
                part.write(content[:text_at])
                for _ in range(2560 if text_at else 0):
                    part.write(b"A" * (1 << 20))
                part.write(content[text_at:])


@pytest.mark.parametrize(
    ("make", "cell", "words"),
    [
        (far_cell, "XFD1048576", "xlsx"),
        (far_cell, "A1048576", "xlsx"),
        (workbook_of_gigabytes, None, "read within"),
    ],
)
def test_a_workbook_that_is_too_large_is_rejected(make, cell, words, tmp_path):
    path = tmp_path / "run.xlsx"
    make(path, cell)
    with pytest.raises(LogError, match=words) as caught:
        read(path)
    assert_one_sentence(caught.value)


@pytest.mark.usefixtures("bounded_memory")
@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_a_table_of_billions_of_equal_cells_is_rejected(kind, tmp_path):
    path = tmp_path / f"run.{kind}"
    cells = pa.DictionaryArray.from_arrays(pa.array([0] * 1_000_000, pa.int8()), pa.array([20.0]))
    table = pa.table({"Time": cells, "t1 [degC]": cells})
    small = pa.ipc.IpcWriteOptions(compression="zstd")
    writer = (
        parquet.ParquetWriter(path, table.schema)
        if kind == "parquet"
        else pa.ipc.new_file(str(path), table.schema, options=small)
    )
    with writer:
        for _ in range(300 if kind == "parquet" else 1500):
            writer.write_table(table)
    with pytest.raises(LogError, match="split it into shorter logs"):
        read(path)


@pytest.mark.parametrize("name", ["log.csv", "other.txt"])
@pytest.mark.parametrize(
    "cell", ["9" * 200_000, '"' + "9" * 200_000, 'a"b"c"', '"' * 9], ids=["long", "quoted", "odd", "quotes"]
)
def test_an_odd_cell_of_a_table_is_read_or_rejected(name, cell, tmp_path):
    path = tmp_path / name
    lines = ["time_s,t1_degC,t2_degC,nut_position_m,screw_speed_rpm,ambient_degC"]
    lines += [f"{i},{cell if i == 12 else 21.5},22.5,0.5,1200,21" for i in range(30)]
    path.write_text("\n".join(lines) + "\n")
    try:
        log = read(path)
    except LogError as error:
        assert_one_sentence(error)
    else:
        assert len(log) >= 29
        assert not np.isfinite(log["t1_degC"][12])
