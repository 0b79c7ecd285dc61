"""What is written reads back to the last bit, and nothing is left half-written."""

import gzip
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from observer.errors import LogError
from observer.files.logs import SUFFIXES, read_log
from observer.files.writer import TableWriter, write_log


@given(
    values=hnp.arrays(
        np.float64, st.integers(1, 20), elements=st.floats(allow_nan=True, allow_infinity=False)
    ),
    suffix=st.sampled_from(SUFFIXES),
)
@settings(max_examples=60)
def test_reads_back_to_the_last_bit(values, suffix):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log{suffix}"
        time_s = 1.8e9 + 0.1 * np.arange(len(values))
        write_log(path, time_s, {"a": values, "b": values[::-1]})
        log = read_log(path)
        assert log.time_s.tobytes() == time_s.tobytes()
        expected = np.where(np.isnan(values), np.nan, values)  # an empty cell has one NaN only
        read = np.where(np.isnan(log.values[:, 0]), np.nan, log.values[:, 0])
        assert read.tobytes() == expected.tobytes()


def test_csv_is_short_and_plain(tmp_path):
    with TableWriter(tmp_path / "x.csv") as writer:
        writer.write({"time_s": np.array([0.0, 0.5]), "quality_t1": np.array(["good", "missing"])})
        writer.write({"time_s": np.array([1e-7]), "quality_t1": np.array(["stale"])})
    assert (tmp_path / "x.csv").read_text() == "time_s,quality_t1\n0,good\n0.5,missing\n1e-7,stale\n"


def test_gzip_has_no_date_so_the_same_log_is_the_same_file(tmp_path):
    write_log(tmp_path / "a.csv.gz", np.arange(3.0), {"x": np.ones(3)})
    assert (tmp_path / "a.csv.gz").read_bytes()[4:8] == b"\0\0\0\0"
    assert gzip.decompress((tmp_path / "a.csv.gz").read_bytes()).startswith(b"time_s,x\n")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failure_leaves_the_older_file_and_no_part(tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    path.write_text("older")

    def fail() -> None:
        with TableWriter(path) as writer:
            writer.write({"time_s": np.arange(10.0)})
            raise RuntimeError("the disk caught fire")

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "older"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full is Linux's disk that is always full")
def test_a_full_disk_is_one_sentence(tmp_path, monkeypatch):
    writer = TableWriter(tmp_path / "out.csv")
    (tmp_path / ".out.csv.part").symlink_to("/dev/full")
    with pytest.raises(LogError, match=r"out\.csv: cannot be written"), writer:
        writer.write({"time_s": np.arange(100_000.0)})
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_place_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LogError, match="cannot be written"):
        write_log(tmp_path / "file" / "log.csv", np.zeros(1), {})
