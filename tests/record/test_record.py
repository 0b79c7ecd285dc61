"""The recording: every bit of every reading, whatever the disk does and however the process ends."""

import math
import signal
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from observer.align.aligner import Aligner, faults_of, frames_of_log
from observer.files.logs import read_log
from observer.frames import Reading
from observer.record.recorder import Companions, Recorder, header, row_of_reading
from observer.record.retention import Retention
from tests.logs.recordings import CHANNELS, joined, plan, play, same_bits, streams
from tests.patience import PATIENCE_S, Stopwatch
from tests.patience import until as _wait


def _rows(recorder: Recorder, first: int, count: int) -> None:
    for k in range(first, first + count):
        recorder.reading(Reading(float(k), {"t1_degC": math.sin(k)}))
        recorder.tick(k + 0.5)


@given(events=streams)
@settings(max_examples=60)
def test_a_reading_reads_back_as_it_was_used(events):
    aligner = Aligner(plan())
    used = [aligner.ingest(event) for event in events if isinstance(event, Reading)]
    if not used:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.csv"
        path.write_bytes(header(CHANNELS) + b"".join(row_of_reading(r, CHANNELS) for r in used))
        log = read_log(path)
    for row, reading in enumerate(used):
        assert log.time_s[row] == reading.time_s
        flags = faults_of(log.flags[row])
        for j, name in enumerate(CHANNELS):
            value = reading.values.get(name, math.nan)
            np.testing.assert_array_equal(log.values[row, j], value)
            expected = reading.faults.get(
                name, "missing" if name in reading.values and math.isnan(value) else None
            )
            assert flags.get(name) == expected


def test_rows_can_be_read_while_the_recorder_lives_where_its_status_says(tmp_path):
    recorder = Recorder(tmp_path / "new" / "folder", "lathe-z", CHANNELS, 1e9, 5.0)
    _rows(recorder, 0, 10)
    _wait(lambda: recorder.status.rows_written == 20)
    status = recorder.status
    assert status.path.name.startswith("lathe-z-20")
    assert status.path.name.endswith("Z.csv")
    assert len(read_log(status.path)) == 20  # readable while the recorder lives
    assert recorder.close()
    assert (status.rows_dropped, status.reason) == (0, None)


def test_a_full_part_ends_with_a_tick_and_each_part_is_independent(tmp_path):
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 2000, 5.0)
    _rows(recorder, 0, 200)
    assert recorder.close()
    logs = sorted((read_log(path) for path in tmp_path.glob("*.csv")), key=lambda log: log.time_s[0])
    assert len(logs) > 3
    assert all(log.step[-1] for log in logs)
    assert all(2000 <= log.path.stat().st_size < 2100 for log in logs[:-1])
    np.testing.assert_array_equal(np.concatenate([log.time_s for log in logs]), np.arange(0, 200, 0.5))


def test_an_unwritable_folder_is_reported_and_nothing_is_lost_once_it_is_fixed(tmp_path):
    place = tmp_path / "disk"
    place.write_text("a file where the folder should be")
    recorder = Recorder(place, "m-x", CHANNELS, 1e9, 5.0)
    _rows(recorder, 0, 5)
    _wait(lambda: recorder.status.reason is not None)
    assert "cannot be written" in recorder.status.reason
    place.unlink()
    _wait(lambda: recorder.status.rows_written == 10)
    assert recorder.status.reason is None
    recorder.close()
    assert len(read_log(next(place.glob("*.csv")))) == 10


def test_rows_beyond_the_bound_are_counted(tmp_path, monkeypatch):
    monkeypatch.setattr("observer.record.recorder._CAPACITY_ROWS", 6)
    place = tmp_path / "disk"
    place.write_text("")
    recorder = Recorder(place, "m-x", CHANNELS, 1e9, 5.0)
    _rows(recorder, 0, 5)
    assert recorder.status.rows_dropped == 4
    assert not recorder.close()


def test_a_refused_write_leaves_no_part_of_a_row(tmp_path, monkeypatch):
    """The disk takes half a batch, then none, then all of it."""
    import os

    real, calls = os.pwrite, []

    def full_disk(fd, data, offset):
        calls.append(len(data))
        if len(calls) == 2:
            return real(fd, bytes(data)[: len(data) // 2], offset)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        return real(fd, data, offset)

    monkeypatch.setattr("observer.record.recorder.os.pwrite", full_disk)
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 5.0)
    _rows(recorder, 0, 3)
    _wait(lambda: recorder.status.reason is not None)
    assert "No space left" in recorder.status.reason
    assert next(tmp_path.glob("*.csv")).read_bytes() == header(CHANNELS)
    _wait(lambda: recorder.status.rows_written == 6)
    recorder.close()
    assert len(read_log(next(tmp_path.glob("*.csv")))) == 6


def test_a_deleted_file_is_replaced(tmp_path):
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 5.0)
    _rows(recorder, 0, 1)
    _wait(lambda: recorder.status.rows_written == 2)
    recorder.status.path.unlink()
    _rows(recorder, 10, 1)
    recorder.close()
    assert read_log(next(tmp_path.glob("*.csv"))).time_s[0] == 10


CRASHER = """
import sys, time
from pathlib import Path
from observer.frames import Reading
from observer.record.recorder import Recorder
recorder = Recorder(Path(sys.argv[1]), "m-x", ("t1_degC",), 1e9, 1.0)
for k in range(10**9):
    recorder.reading(Reading(time.time(), {"t1_degC": k / 7}))
    recorder.tick(time.time())
    if k == 200:
        print("go", flush=True)
    time.sleep(0.002)
"""


@pytest.mark.system
def test_kill_9_loses_at_most_the_last_second(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", CRASHER, str(tmp_path)], stdout=subprocess.PIPE)
    watch = Stopwatch(process.pid)
    try:
        assert process.stdout.readline() == b"go\n"
    finally:
        held_up_s = watch.held_up_s()
        process.send_signal(signal.SIGKILL)
        killed_s = time.time()
        process.wait(PATIENCE_S)
        process.stdout.close()
    log = read_log(next(tmp_path.glob("*.csv")), accept_truncated=True)
    assert killed_s - log.time_s[-1] - held_up_s < 1.0
    np.testing.assert_array_equal(log.values[~log.step, 0], np.arange(np.sum(~log.step)) / 7)


def test_a_recording_cut_anywhere_replays_up_to_the_cut(tmp_path):
    events = [
        Reading(0.2, {"t1_degC": 20.0 + k, "nut_position_m": 0.1}, {}) if k % 3 else 0.1 for k in range(1, 40)
    ]
    live, data = play(events, Aligner(plan()))
    rows = data.splitlines(keepends=True)
    for cut in range(len(data) - len(rows[-1]) + 1, len(data)):
        path = tmp_path / "cut.csv"
        path.write_bytes(data[:cut])
        log = read_log(path, CHANNELS, accept_truncated=True)
        assert len(log) == len(rows) - 2
        replayed = joined(list(frames_of_log(log, plan())))
        assert same_bits(replayed, joined(live[: len(replayed["time_s"])]))


def test_only_the_owner_may_read_recordings(tmp_path):
    folder = tmp_path / "new"
    recorder = Recorder(folder, "m-x", CHANNELS, 1e9, 5.0, companions=Companions(start=b"where it stood"))
    _rows(recorder, 0, 3)
    recorder.close()
    modes = {path.suffix: stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()}
    assert modes == {".csv": 0o600, ".start": 0o600}
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_each_write_ends_with_a_checksum(tmp_path):
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 5.0)
    for k in range(3):
        _rows(recorder, 10 * k, 2)
        _wait(lambda k=k: recorder.status.rows_written == 4 * (k + 1))
    recorder.close()
    (path,) = tmp_path.glob("*.csv")
    assert path.read_bytes().count(b"#crc=") >= 3
    assert path.read_bytes().splitlines()[-1].split(b",")[-1].startswith(b"#crc=")
    assert len(read_log(path)) == 12


def test_the_checkpoint_of_the_start_goes_beside_the_first_file_only(tmp_path):
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1000, 5.0, companions=Companions(start=b"where it stood"))
    _rows(recorder, 0, 100)
    recorder.close()
    (start,) = tmp_path.glob("*.start")
    assert start.read_bytes() == b"where it stood"
    files = sorted(tmp_path.glob("*.csv"), key=lambda path: read_log(path).time_s[0])
    assert len(files) > 2
    assert start.stem == files[0].stem


def test_full_files_go_beyond_the_size_that_is_kept(tmp_path):
    foreign = tmp_path / "other-x-20200101T000000Z.csv"
    foreign.write_text("not ours")
    keep = Retention(keep_bytes=5000)
    recorder = Recorder(tmp_path, "m-x", CHANNELS, 2000, 5.0, keep)
    for k in range(40):
        _rows(recorder, 20 * k, 20)
        _wait(lambda k=k: recorder.status.rows_written == 40 * (k + 1))
    recorder.close()
    kept = list(tmp_path.glob("m-x-*.csv"))
    assert 2000 < sum(path.stat().st_size for path in kept) < 5000 + 2 * 2500
    assert max(read_log(path).time_s[-1] for path in kept) == 799.5  # the newest stays
    assert foreign.exists()


def test_a_recorder_whose_thread_ends_is_not_alive_and_says_why(tmp_path, monkeypatch):
    def defect(*_):
        raise ZeroDivisionError("a defect")

    recorder = Recorder(tmp_path, "m-x", CHANNELS, 1e9, 5.0)
    assert recorder.alive
    monkeypatch.setattr(recorder, "_drain", defect)
    _rows(recorder, 0, 1)
    _wait(lambda: not recorder.alive)
    assert "a defect" in recorder.status.reason
    assert not recorder.close()
