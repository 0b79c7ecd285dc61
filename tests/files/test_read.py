"""A log is read exactly, or refused with one sentence that says where and what to do."""

import gzip
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from observer.errors import LogError
from observer.files.logs import read_log

GOOD = "time_s,t1_degC,nut_position_m\n0,20.5,0.1\n0.5,,0.2\n1.25,21,\n"


def _write(folder: Path, text: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    data = text.encode() if isinstance(text, str) else text
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
@pytest.mark.parametrize(
    "text", [GOOD, GOOD.replace("\n", "\r\n"), "\ufeff" + GOOD, GOOD.rstrip(), GOOD + "\n"]
)
def test_reads_values_and_empty_cells(tmp_path, name, text):
    log = read_log(_write(tmp_path, text, name))
    assert log.channels == ("t1_degC", "nut_position_m")
    np.testing.assert_array_equal(log.time_s, [0, 0.5, 1.25])
    np.testing.assert_array_equal(log.values, [[20.5, 0.1], [np.nan, 0.2], [21, np.nan]])
    assert log.step is None
    assert log.flags is None


def test_reads_parquet_of_any_numeric_type(tmp_path):
    table = pa.table(
        {"time_s": pa.array([1, 2], pa.int32()), "t1_degC": pa.array([20.5, None], pa.float32())}
    )
    parquet.write_table(table, tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet", ["t1_degC"])
    np.testing.assert_array_equal(log.time_s, [1, 2])
    np.testing.assert_array_equal(log.values, [[20.5], [np.nan]])


def test_ignores_columns_nobody_needs(tmp_path):
    path = _write(tmp_path, "time_s,comment,t1_degC,\n0,warm up,20,x\n1,,21,y\n")
    log = read_log(path, ["t1_degC"])
    assert log.channels == ("t1_degC",)
    np.testing.assert_array_equal(log.values, [[20], [21]])


def test_takes_the_needed_order_of_the_file_not_of_the_request(tmp_path):
    log = read_log(_write(tmp_path, GOOD), ["nut_position_m", "t1_degC"])
    assert log.channels == ("t1_degC", "nut_position_m")


def test_a_column_step_alone_is_an_ordinary_column(tmp_path):
    log = read_log(_write(tmp_path, "time_s,step\n0,1\n1,2\n"))
    assert log.channels == ("step",)
    assert log.step is None


def test_reads_a_recording(tmp_path):
    text = "time_s,t1_degC,step,flags\n0,20,,\n0.1,,,t1_degC=open_circuit\n0.5,,1,\n"
    log = read_log(_write(tmp_path, text), ["t1_degC"])
    assert log.channels == ("t1_degC",)
    np.testing.assert_array_equal(log.step, [False, False, True])
    assert log.flags == (None, "t1_degC=open_circuit", None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["first column", "time_s"]),
        ("t1_degC,time_s\n1,2\n", ["first column", "'t1_degC'"]),
        ("time_s,t1_degC\n", ["no rows"]),
        ("time_s;t1_degC\n0;1\n", ["semicolons", "commas"]),
        ("time_s;t1_degC\n0;21,5\n", ["semicolons", "commas", "numbers with a point"]),
        ("time_s,a,a\n0,1,1\n", ['"a"', "twice"]),
        ("time_s,a\n0,1\n1,x\n", ["row 2 (line 3)", '"a"', "'x'", "not a number"]),
        ("time_s,a\n\n0,1\n1,1_0\n", ["row 2 (line 4)", "'1_0'"]),
        ("time_s,a\n0,1\n1\n2,1\n", ["row 2 (line 3)", "1 cells", "names 2"]),
        ("time_s,a\n0,1\n0,1\n", ["row 2 (line 3)", "repeats 0.0"]),
        ("time_s,a\n5,1\n4,1\n", ["row 2 (line 3)", "goes back from 5.0 to 4.0"]),
        ("time_s,a\n0,1\n,1\n", ["row 2 (line 3)", "time_s", "empty"]),
        ("time_s,a\n0,1\ninf,1\n", ["row 2 (line 3)", "not finite"]),
        ("time_s,a\n0,1\n1,2\n2", ["row 3 (line 4)", "cut off", "--accept-truncated"]),
        (b"\xff\xfe\x00time", ["UTF-8"]),
    ],
)
def test_refuses_with_place_and_remedy(tmp_path, text, words):
    path = _write(tmp_path, text)
    with pytest.raises(LogError) as caught:
        read_log(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


def test_names_missing_columns_and_similar_ones(tmp_path):
    with pytest.raises(LogError, match=r'columns "t1_degc" \(did you mean "t1_degC"\?\), "zzz" are missing'):
        read_log(_write(tmp_path, GOOD), ["t1_degc", "zzz"])


def test_suggests_no_column_that_is_another_channels(tmp_path):
    with pytest.raises(LogError, match=r'column "t9_degC" is missing; add it to the log or name another in'):
        read_log(_write(tmp_path, GOOD), ["t1_degC", "t9_degC"])


@pytest.mark.parametrize("name", ["log.txt", "log"])
def test_refuses_an_unknown_kind(tmp_path, name):
    with pytest.raises(LogError, match="unknown kind of log"):
        read_log(_write(tmp_path, GOOD, name))


def test_rejects_a_missing_path_or_one_that_is_not_a_file(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "log.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "folder.csv")


def test_refuses_damaged_parquet(tmp_path):
    whole = tmp_path / "whole.parquet"
    parquet.write_table(pa.table({"time_s": np.arange(9.0)}), whole)
    with pytest.raises(LogError, match="damaged or not Parquet"):
        read_log(_write(tmp_path, whole.read_bytes()[:-20], "cut.parquet"))


def test_refuses_text_in_a_parquet_column(tmp_path):
    parquet.write_table(pa.table({"time_s": [0.0], "a": ["warm"]}), tmp_path / "log.parquet")
    with pytest.raises(LogError, match='column "a" holds string'):
        read_log(tmp_path / "log.parquet")


def test_a_cut_gzip_is_rejected_or_read_up_to_the_cut(tmp_path):
    text = "time_s,a\n" + "".join(f"{i},{math.sin(i)!r}\n" for i in range(5000))
    data = gzip.compress(text.encode())
    path = tmp_path / "log.csv.gz"
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(LogError, match="is cut off"):
        read_log(path)
    log = read_log(path, accept_truncated=True)
    assert 100 < len(log) < 5000
    np.testing.assert_array_equal(log.values[:, 0], [math.sin(i) for i in range(len(log))])


def test_damaged_gzip_is_rejected(tmp_path):
    path = tmp_path / "log.csv.gz"
    path.write_bytes(b"time_s,a\n0,1\n")
    with pytest.raises(LogError, match="damaged gzip"):
        read_log(path)


@pytest.mark.parametrize("tail", ["2", "2,", "2,1.5", "2,1.5,", "2,1.5,1", "2,1.5,1,", "2,1.5,1,t1_degC=op"])
def test_a_recording_cut_anywhere_loses_only_its_last_row(tmp_path, tail):
    """Also where all cells seem to be there: a recorded row is whole only with its newline."""
    path = _write(tmp_path, "time_s,t1_degC,step,flags\n0,1.5,,\n1,,1,\n" + tail)
    with pytest.raises(LogError, match=r"row 3 \(line 4\) is cut off"):
        read_log(path)
    log = read_log(path, accept_truncated=True)
    np.testing.assert_array_equal(log.time_s, [0, 1])


def test_blank_disk_blocks_at_the_end_count_as_a_cut(tmp_path):
    path = _write(tmp_path, b"time_s,a\n0,1\n1,2\n" + b"\0" * 512)
    with pytest.raises(LogError, match="cut off"):
        read_log(path)
    assert len(read_log(path, accept_truncated=True)) == 2
