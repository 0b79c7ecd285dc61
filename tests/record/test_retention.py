"""What is removed of the recordings: the oldest complete files of this service, and nothing else."""

import fcntl
import os
import shutil
from pathlib import Path

import pytest

from observer.config.publishing import RecordSettings
from observer.record import retention
from observer.record.retention import Recording, Retention, tidy, to_remove

NOW_S = 1.8e9
DAY_S = 86_400.0
LARGE = (100_000_000_000, 50_000_000_000)  # bytes in all, and free
FILES = [Recording(Path(f"m-x-2027010{k}T000000Z.csv"), 1_000, NOW_S - (10 - k) * DAY_S) for k in range(1, 8)]


def _gone(keep: Retention, disk: tuple[int, int] = LARGE, *, by_age: bool = True) -> list[Recording]:
    return list(to_remove(reversed(FILES), keep, *disk, NOW_S, by_age=by_age))


def test_everything_stays_unless_something_says_otherwise():
    assert _gone(Retention()) == []
    assert _gone(Retention.of(RecordSettings())) == []


def test_the_oldest_files_go_first_by_age_by_size_and_for_free_space():
    assert _gone(Retention(keep_s=5 * DAY_S)) == FILES[:4]
    assert _gone(Retention(keep_bytes=3_500)) == FILES[:4]
    assert _gone(Retention(free_bytes=2e9), (100_000_000_000, 1_999_998_500)) == FILES[:2]


def test_an_age_counts_only_by_a_clock_that_can_be_trusted():
    keep = Retention(5 * DAY_S)
    assert _gone(keep, by_age=False) == []
    unset = [Recording(Path("m-x-19700101T000100Z.csv"), 1_000, 60.0)]
    assert list(to_remove(unset, keep, *LARGE, NOW_S, by_age=True)) == []


def test_a_small_disk_is_not_emptied_for_what_stays_free_on_a_large_one():
    assert _gone(Retention(free_bytes=1e9), (500_000_000, 60_000_000)) == []
    assert len(_gone(Retention(free_bytes=1e9), (500_000_000, 49_998_500))) == 2


@pytest.fixture
def folder(tmp_path):
    for k in range(1, 5):
        path = tmp_path / f"m-x-2026010{k}T000000Z.csv"
        path.write_bytes(bytes(1000))
        os.utime(path, (NOW_S - (10 - k) * DAY_S,) * 2)
    (tmp_path / "m-x-20260101T000000Z.start").write_bytes(bytes(500))
    return tmp_path


def test_only_complete_files_of_this_service_go(folder):
    for name in ("m-x.checkpoint", "m-xy-20200101T000000Z.csv", "m-x-20200101T000000Z.csv.gz", "notes.csv"):
        (folder / name).write_bytes(bytes(5000))
    (folder / "m-x-20200101T000000Z.csv").symlink_to(folder / "notes.csv")
    gone = tidy(folder, "m-x", Retention(keep_bytes=2000), NOW_S, by_age=False)
    assert [path.name for path in gone] == ["m-x-20260101T000000Z.csv", "m-x-20260102T000000Z.csv"]
    left = {path.name for path in folder.iterdir()}
    assert "m-x-20260101T000000Z.start" not in left  # what lies beside a file goes with it
    assert {"m-x.checkpoint", "notes.csv", "m-x-20200101T000000Z.csv", "m-x-20260104T000000Z.csv"} <= left


def test_a_file_that_somebody_writes_stays(folder):
    oldest = folder / "m-x-20260101T000000Z.csv"
    with oldest.open("ab") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        tidy(folder, "m-x", Retention(keep_bytes=0), NOW_S, by_age=False)
        assert [path.name for path in folder.glob("*.csv")] == [oldest.name]
    tidy(folder, "m-x", Retention(keep_bytes=0), NOW_S, by_age=False)
    assert not oldest.exists()


def test_a_nearly_full_disk_is_reported_in_time(folder, monkeypatch):
    usage = type(shutil.disk_usage(folder))
    monkeypatch.setattr(retention.shutil, "disk_usage", lambda _: usage(100e9, 99.5e9, 0.5e9))
    for keep in (Retention(free_bytes=1e9), Retention(free_bytes=0.0)):
        assert "only 0.5 GB are free, less than 1 GB" in retention.shortage(folder, keep)
    assert retention.shortage(folder, Retention(free_bytes=0.4e9)) is None
