"""A flipped digit in a recording is reported with its rows; recordings without checksums still read."""

import math
import zlib

import numpy as np
import pytest

from observer.errors import LogError
from observer.files.logs import read_log
from observer.frames import Reading
from observer.record.recorder import Part, header, row_of_reading

CHANNELS = ("t1_degC", "t2_degC")


def _recording(folder, blocks=4, rows=5) -> bytes:
    """A recording as the service writes it: some rows a write, the last of one carries faults."""
    part = Part()
    part.open(folder, "m-x", header(CHANNELS), {})
    for block in range(blocks):
        lines = []
        for row in range(rows):
            k = block * rows + row
            faults = {"t1_degC": "open_circuit"} if row == rows - 1 and block % 2 else {}
            reading = Reading(100.0 + 0.1 * k, {"t1_degC": 20.0 + math.sin(k), "t2_degC": 0.1 * k}, faults)
            lines.append(row_of_reading(reading, CHANNELS))
        part.write(b"".join(lines))
    path = part.path
    part.close()
    return path.read_bytes()


def test_a_recording_reads_back_and_its_checksums_are_no_faults(tmp_path):
    data = _recording(tmp_path)
    (path,) = tmp_path.glob("*.csv")
    log = read_log(path)
    assert len(log) == 20
    assert data.count(b"#crc=") == 4
    assert [flags for flags in log.flags if flags and "open_circuit" in flags]
    first = data[: data.index(b"#crc=")]
    assert data[len(first) + 5 :].startswith(f"{zlib.crc32(first):08x}".encode())  # any CRC-32 can check it


def test_any_flipped_bit_is_reported(tmp_path):
    data = bytearray(_recording(tmp_path, blocks=2, rows=3))
    path = tmp_path / "flipped.csv"
    for place in range(len(data)):
        for bit in (0, 3):
            data[place] ^= 1 << bit
            path.write_bytes(data)
            with pytest.raises(LogError):
                read_log(path)
            data[place] ^= 1 << bit


def test_says_which_rows_and_reads_the_others_where_that_is_accepted(tmp_path):
    lines = _recording(tmp_path).splitlines(keepends=True)
    lines[8] = lines[8].replace(b"20.", b"21.") if b"20." in lines[8] else lines[8].replace(b"2", b"3", 1)
    path = tmp_path / "flipped.csv"
    path.write_bytes(b"".join(lines))
    with pytest.raises(
        LogError, match=r"rows 6 to 10 \(lines 7 to 11\) do not have the checksum .*--accept-d"
    ):
        read_log(path)
    log = read_log(path, accept_damaged=True)
    np.testing.assert_allclose(log.time_s, 100.0 + 0.1 * np.r_[0:5, 10:20])


def test_rows_after_the_last_checksum_pass_as_a_crash_leaves_them(tmp_path):
    data = _recording(tmp_path)
    path = tmp_path / "crashed.csv"
    path.write_bytes(data + b"200.0,20.5,1.0,,,\n201.0,20.")
    with pytest.raises(LogError, match="cut off"):
        read_log(path)
    assert len(read_log(path, accept_truncated=True)) == 21


def test_a_recording_of_an_older_version_has_no_checksum_to_miss(tmp_path):
    path = tmp_path / "old.csv"
    path.write_bytes(b"time_s,t1_degC,t2_degC,step,flags\n1.0,20.5,,,t2_degC=timeout\n1.5,,,1,\n")
    assert read_log(path).flags == ("t2_degC=timeout", None)
