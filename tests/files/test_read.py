"""A log is read exactly, or rejected in one sentence that says where and what to do."""

import gzip
import math
import zlib

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from observer.config.logs import Logs
from observer.errors import LogError
from observer.files.logs import read_log
from observer.frames import Reading
from observer.record.recorder import Part, header, row_of_reading

GOOD = "time_s,t1_degC,nut_position_m\n0,20.5,0.1\n0.5,,0.2\n1.25,21,\n"
CHANNELS = ("t1_degC", "t2_degC")
MOST_S = Logs().rows_apart_s


@pytest.fixture
def write(tmp_path):
    def written(content, name="log.csv"):
        path = tmp_path / name
        if isinstance(content, dict):
            parquet.write_table(pa.table(content), path)
            return path
        data = content.encode() if isinstance(content, str) else content
        path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
        return path

    return written


def times(*values):
    return "time_s,t1_degC\n" + "".join(f"{value},20.5\n" for value in values)


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
@pytest.mark.parametrize(
    "text", [GOOD, GOOD.replace("\n", "\r\n"), "\ufeff" + GOOD, GOOD.rstrip(), GOOD + "\n"]
)
def test_a_log_has_its_values_and_nan_for_empty_cells(write, name, text):
    log = read_log(write(text, name))
    assert log.channels == ("t1_degC", "nut_position_m")
    np.testing.assert_array_equal(log.time_s, [0, 0.5, 1.25])
    np.testing.assert_array_equal(log.values, [[20.5, 0.1], [np.nan, 0.2], [21, np.nan]])
    assert (log.step, log.flags) == (None, None)


@pytest.mark.parametrize(
    ("text", "needed", "channels"),
    [
        ("time_s,comment,t1_degC,\n0,warm up,20,x\n1,,21,y\n", ["t1_degC"], ("t1_degC",)),
        (GOOD, ["nut_position_m", "t1_degC"], ("t1_degC", "nut_position_m")),
        ("time_s,step\n0,1\n1,2\n", ["step"], ("step",)),
    ],
    ids=["only what is needed", "in the order of the file", "a step without flags is a channel"],
)
def test_a_log_has_the_needed_columns(write, text, needed, channels):
    log = read_log(write(text), needed)
    assert log.channels == channels
    assert log.step is None


def test_parquet_of_any_numeric_type_is_read_and_its_infinite_numbers_are_counted(write):
    values = pa.array([1.0, math.inf, None, -math.inf], pa.float32())
    log = read_log(write({"time_s": pa.array([0, 1, 2, 3], pa.int32()), "t1_degC": values}, "log.parquet"))
    np.testing.assert_array_equal(log.time_s, [0, 1, 2, 3])
    np.testing.assert_array_equal(log.values[:, 0], [1.0, np.inf, np.nan, -np.inf])
    (words,) = log.words
    assert (words.column, words.cells, words.texts) == ("t1_degC", 2, ("inf",))


REJECTED = [
    ("log.csv", "", ["first column", "time_s"]),
    ("log.csv", "t1_degC,time_s\n1,2\n", ["first column", "'t1_degC'"]),
    ("log.csv", "time_s,t1_degC\n", ["no rows"]),
    ("log.csv", "time_s;t1_degC\n0;1\n", ["semicolons", "commas"]),
    ("log.csv", "time_s;t1_degC\n0;21,5\n", ["semicolons", "commas", "numbers with a point"]),
    ("log.csv", "time_s,a,a\n0,1,1\n", ['"a"', "twice"]),
    ("log.csv", "time_s,a\n0,1\n1,x\n", ["row 2 (line 3)", '"a"', "'x'", "not a number"]),
    ("log.csv", "time_s,a\n\n0,1\n1,1_0\n", ["row 2 (line 4)", "'1_0'"]),
    ("log.csv", "time_s,a\n0,1\n1\n2,1\n", ["row 2 (line 3)", "1 cells", "names 2"]),
    ("log.csv", "time_s,a\n0,1\n0,1\n", ["row 2 (line 3)", "repeats 0.0"]),
    ("log.csv", "time_s,a\n5,1\n4,1\n", ["row 2 (line 3)", "goes back from 5.0 to 4.0"]),
    ("log.csv", "time_s,a\n0,1\n,1\n", ["row 2 (line 3)", "time_s", "empty"]),
    ("log.csv", "time_s,a\n0,1\ninf,1\n", ["row 2 (line 3)", "not finite"]),
    ("log.csv", "time_s,a\n0,1\n1,2\n2", ["row 3 (line 4)", "cut off", "--accept-truncated"]),
    ("log.csv", b"\xff\xfe\x00time", ["UTF-8"]),
    ("log.csv", times(*range(1_700_000_000_000, 1_700_000_005_000, 1000)), ["milliseconds", "by 1e3"]),
    ("log.csv", times(*range(17 * 10**14, 17 * 10**14 + 5 * 10**6, 10**6)), ["microseconds", "by 1e6"]),
    ("log.csv", times(*range(17 * 10**17, 17 * 10**17 + 5 * 10**9, 10**9)), ["nanoseconds", "by 1e9"]),
    ("log.csv", times(*range(0, 60_000, 1000)), ["16.7 min apart", "lasts 16.4 h", "rows_apart_s"]),
    ("log.txt", GOOD, ["unknown kind of log"]),
    ("log", GOOD, ["unknown kind of log"]),
    ("log.parquet", b"PAR1 no more of it", ["damaged or not Parquet"]),
    ("log.parquet", {"time_s": [0.0], "a": ["warm"]}, ['column "a" holds string']),
]


@pytest.mark.parametrize(("name", "content", "words"), REJECTED)
def test_a_log_that_cannot_be_read_is_rejected_with_place_and_remedy(write, name, content, words):
    path = write(content, name)
    with pytest.raises(LogError) as caught:
        read_log(path, rows_apart_s=MOST_S)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize(
    ("needed", "words"),
    [
        (["t1_degc", "zzz"], r'columns "t1_degc" \(did you mean "t1_degC"\?\), "zzz" are missing'),
        (["t1_degC", "t9_degC"], 'column "t9_degC" is missing; add it'),
    ],
    ids=["a similar one is suggested", "no column of another channel is suggested"],
)
def test_missing_columns_are_named(write, needed, words):
    with pytest.raises(LogError, match=words):
        read_log(write(GOOD), needed)


def test_a_missing_path_or_one_that_is_not_a_file_is_rejected(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_log(tmp_path / "log.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "folder.csv")


@pytest.mark.parametrize("apart_s", [0.01, 1.0, 60.0, 300.0])
def test_a_log_with_a_pause_of_weeks_is_read(write, apart_s):
    rows = [1.7e9 + apart_s * i + (0 if i < 15 else 3e6) for i in range(40)]
    assert len(read_log(write(times(*rows)), rows_apart_s=MOST_S)) == 40


def test_rows_may_be_as_far_apart_as_configured(write):
    assert len(read_log(write(times(*range(0, 60_000, 1000))), rows_apart_s=1500.0)) == 60


def test_words_that_mean_missing_are_counted_by_needed_column(write):
    cells = ["inf", "NULL", "20", "", "NaN", " nan ", "NULL", "-inf", "21", "NA"]
    rows = "".join(f"{i},{cell},1,NaN\n" for i, cell in enumerate(cells))
    log = read_log(write("time_s,t1_degC,nan,note\n" + rows), ["t1_degC", "nan"])
    (words,) = log.words
    assert (words.column, words.cells) == ("t1_degC", 7)
    assert set(words.texts) == {"inf", "NULL", "NaN", "nan", "-inf", "NA"}
    assert words.text.startswith("channel t1_degC: 7 cells say NULL, ")
    assert not np.isfinite(log.values[[0, 1, 3, 4, 5, 6, 7, 9], 0]).any()


# ---- damage ----


def test_a_cut_gzip_is_rejected_or_read_up_to_the_cut(tmp_path):
    data = gzip.compress(("time_s,a\n" + "".join(f"{i},{math.sin(i)!r}\n" for i in range(5000))).encode())
    path = tmp_path / "log.csv.gz"
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(LogError, match="is cut off"):
        read_log(path)
    log = read_log(path, accept_truncated=True)
    assert 100 < len(log) < 5000
    np.testing.assert_array_equal(log.values[:, 0], [math.sin(i) for i in range(len(log))])
    path.write_bytes(b"time_s,a\n0,1\n")
    with pytest.raises(LogError, match="damaged gzip"):
        read_log(path)


@pytest.mark.parametrize("tail", ["2", "2,", "2,1.5", "2,1.5,", "2,1.5,1", "2,1.5,1,", "2,1.5,1,t1_degC=op"])
def test_a_recording_cut_anywhere_loses_only_its_last_row(write, tail):
    """Also where all cells seem to be there: a recorded row is whole only with its newline."""
    path = write("time_s,t1_degC,step,flags\n0,1.5,,\n1,,1,t1_degC=open_circuit\n" + tail)
    with pytest.raises(LogError, match=r"row 3 \(line 4\) is cut off"):
        read_log(path)
    log = read_log(path, ["t1_degC"], accept_truncated=True)
    assert log.channels == ("t1_degC",)
    np.testing.assert_array_equal(log.time_s, [0, 1])
    np.testing.assert_array_equal(log.step, [False, True])
    assert log.flags == (None, "t1_degC=open_circuit")


def test_blank_disk_blocks_at_the_end_of_a_log_count_as_a_cut(write):
    path = write(b"time_s,a\n0,1\n1,2\n" + b"\0" * 512)
    with pytest.raises(LogError, match="cut off"):
        read_log(path)
    assert len(read_log(path, accept_truncated=True)) == 2


@pytest.fixture
def recording(tmp_path):
    """A recording as the service writes it: five rows a write, every tenth with a fault."""
    part = Part()
    part.open(tmp_path, "m-x", header(CHANNELS), {})
    for first in range(0, 20, 5):
        lines = []
        for k in range(first, first + 5):
            faults = {"t1_degC": "open_circuit"} if k % 10 == 9 else {}
            values = {"t1_degC": 20.0 + math.sin(k), "t2_degC": 0.1 * k}
            lines.append(row_of_reading(Reading(100.0 + 0.1 * k, values, faults), CHANNELS))
        part.write(b"".join(lines))
    path = part.path
    part.close()
    return path


def test_a_recording_reads_back_and_any_crc_32_can_check_its_checksums(recording):
    assert [k for k, flags in enumerate(read_log(recording).flags) if "open_circuit" in (flags or "")] == [
        9,
        19,
    ]
    data = recording.read_bytes()
    assert data.count(b"#crc=") == 4
    first, _, rest = data.partition(b"#crc=")
    assert rest.startswith(f"{zlib.crc32(first):08x}".encode())


def test_any_flipped_bit_of_a_recording_is_reported(recording):
    data = bytearray(b"".join(recording.read_bytes().splitlines(keepends=True)[:11]))  # two writes
    for place in range(len(data)):
        for bit in (0, 3):
            data[place] ^= 1 << bit
            recording.write_bytes(data)
            with pytest.raises(LogError):
                read_log(recording)
            data[place] ^= 1 << bit


def test_rows_with_a_wrong_checksum_are_named_and_may_be_left_out(recording):
    lines = recording.read_bytes().splitlines(keepends=True)
    lines[8] = lines[8].replace(b"2", b"3", 1)
    recording.write_bytes(b"".join(lines))
    with pytest.raises(LogError, match=r"rows 6 to 10 \(lines 7 to 11\) .* checksum .*--accept-d"):
        read_log(recording)
    log = read_log(recording, accept_damaged=True)
    np.testing.assert_allclose(log.time_s, 100.0 + 0.1 * np.r_[0:5, 10:20])


def test_rows_after_the_last_checksum_are_read_as_a_crash_leaves_them(recording):
    recording.write_bytes(recording.read_bytes() + b"200.0,20.5,1.0,,,\n201.0,20.")
    with pytest.raises(LogError, match="cut off"):
        read_log(recording)
    assert len(read_log(recording, accept_truncated=True)) == 21
