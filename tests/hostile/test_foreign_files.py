"""Files of other programs with damaged bytes are read, or rejected in one sentence; none takes all memory."""

from __future__ import annotations

import gzip
import io
import resource
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow as pa
import pytest
from pyarrow import parquet

from observer.errors import LogError
from observer.files.logs import read_log
from observer.files.writer import write_log
from tests.hostile.bits import damaged
from tests.hostile.test_files import assert_one_sentence
from tests.intake.machine import read, truth
from tests.intake.test_formats import labview, of_feather, of_libreoffice, of_parquet, waveforms, workbook


def german_text(path, measured):
    """A table as a German logger writes it, some cells quoted."""
    columns = zip(
        measured.moments(), measured.t1_degC, measured.t2_degC, measured.nut_position_m, strict=True
    )
    lines = [
        f'"{moment:%d.%m.%Y %H:%M:%S.%f}";{t1:.2f};"{t2:.2f}";{1000.0 * position:.2f}'.replace(".", ",", 0)
        for moment, t1, t2, position in columns
    ]
    path.write_text(
        "\n".join(["Zeit;t1 [degC];t2 [degC];nut position [mm]", *lines]) + "\n", encoding="cp1252"
    )


WRITERS = {
    ".tdms": waveforms,
    ".feather": of_feather,
    ".parquet": of_parquet,
    ".lvm": labview,
    ".xlsx": workbook,
    ".ods": of_libreoffice,
    ".txt": german_text,
}


def mutate_and_read(suffix, folder, count, seed):
    path = folder / f"run{suffix}"
    WRITERS[suffix](path, truth(rows=24))
    rejected = 0
    for label, data in damaged(path.read_bytes(), count, seed):
        path.write_bytes(data)
        try:
            read(path, '\n[log]\ntimezone = "UTC"')
        except LogError:
            rejected += 1
        except BaseException as error:
            error.add_note(label)
            raise
    return rejected


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_damaged_file_of_another_program_is_read_or_rejected(suffix, tmp_path):
    count = 12 if suffix in (".xlsx", ".ods") else 300  # a workbook is read in a process of its own
    assert mutate_and_read(suffix, tmp_path, count, seed=7) > count // 20


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
    path, header = tmp_path / name, b"time_s,t1_degC\n0,"
    path.write_bytes(gzip.compress(header) + zeros_packed(2 << 30))
    for reader in (
        (lambda: read(path), lambda: read_log(path)) if name == "log.csv.gz" else (lambda: read(path),)
    ):
        with pytest.raises(LogError, match="split it into shorter logs") as caught:
            reader()
        assert_one_sentence(caught.value)


@pytest.mark.parametrize("cell", ["XFD1048576", "A1048576"])
def test_a_workbook_with_a_far_cell_is_read_or_rejected(cell, tmp_path):
    path, book = tmp_path / "run.xlsx", openpyxl.Workbook()
    book.active["A1"], book.active[cell] = "Time", 1.0
    book.save(path)
    with pytest.raises(LogError) as caught:
        read(path)
    assert_one_sentence(caught.value)


def test_a_workbook_that_unpacks_to_gigabytes_is_rejected(tmp_path):
    workbook(tmp_path / "good.xlsx", truth(rows=24))
    path = tmp_path / "run.xlsx"
    with (
        zipfile.ZipFile(tmp_path / "good.xlsx") as good,
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as bomb,
    ):
        for name in good.namelist():
            with bomb.open(name, "w", force_zip64=True) as part:
                content = good.read(name)
                text_at = content.find(b"Time") if name == "xl/worksheets/sheet2.xml" else 0
                part.write(content[:text_at])
                for _ in range(2560 if text_at else 0):
                    part.write(b"A" * (1 << 20))
                part.write(content[text_at:])
    with pytest.raises(LogError, match="cannot be read within") as caught:
        read(path)
    assert_one_sentence(caught.value)


@pytest.mark.usefixtures("bounded_memory")
@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_a_table_of_billions_of_equal_cells_is_rejected(kind, tmp_path):
    path = tmp_path / f"run.{kind}"
    cells = pa.DictionaryArray.from_arrays(pa.array([0] * 1_000_000, pa.int8()), pa.array([20.0]))
    table = pa.table({"Time": cells, "t1 [degC]": cells})
    if kind == "parquet":
        with parquet.ParquetWriter(path, table.schema) as writer:
            for _ in range(300):
                writer.write_table(table)
    else:
        with (
            pa.OSFile(str(path), "wb") as sink,
            pa.ipc.new_file(sink, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer,
        ):
            for _ in range(1500):
                writer.write_table(table)
    with pytest.raises(LogError, match="split it into shorter logs"):
        read(path)


@pytest.mark.parametrize("name", ["log.csv", "other.txt"])
@pytest.mark.parametrize(
    "cell", ["9" * 200_000, '"' + "9" * 200_000, 'a"b"c"', '"' * 9], ids=["long", "quoted", "odd", "quotes"]
)
def test_an_odd_cell_of_a_table_is_read_or_rejected(name, cell, tmp_path):
    path = tmp_path / name
    rows = [f"{i},21.5,22.5,0.5,1200,21" for i in range(30)]
    rows[12] = f"12,{cell},22.5,0.5,1200,21"
    path.write_text(
        "\n".join(["time_s,t1_degC,t2_degC,nut_position_m,screw_speed_rpm,ambient_degC", *rows]) + "\n"
    )
    try:
        log = read(path)
    except LogError as error:
        assert_one_sentence(error)
    else:
        assert len(log) >= len(rows) - 1
        assert not np.isfinite(log["t1_degC"][12])


def test_a_changed_byte_of_a_parquet_log_never_becomes_another_value(tmp_path):
    path, measured = tmp_path / "log.parquet", truth()
    write_log(path, measured.time_s, {"t1_degC": measured.t1_degC, "t2_degC": measured.t2_degC})
    whole, good = read_log(path), path.read_bytes()
    rejected = 0
    for label, data in damaged(good, 300, seed=3):
        path.write_bytes(data)
        try:
            log = read_log(path, ["t1_degC", "t2_degC"])
        except LogError as error:
            assert_one_sentence(error)
            rejected += 1
            continue
        np.testing.assert_array_equal(log.time_s, whole.time_s, err_msg=label)
        np.testing.assert_array_equal(log.values, whole.values, err_msg=label)
    assert rejected > 150
