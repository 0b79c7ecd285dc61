"""The page's view of recordings: which there are, and the minimum and maximum of each part of a span."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.frames import Reading
from observer.page import history as subject
from observer.page.history import COARSE_S, FINE_S, Digests, history
from observer.record.recorder import Recorder
from observer.record.spans import recordings

CHANNELS = ("t1_degC", "nut_position_m")
RATE_HZ = 20
SECONDS = 600
START_S = 1199.975  # between two readings: none is on the edge of a part


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Ten minutes as the service records them: a slow temperature and a fast position, in blocks."""
    path = tmp_path_factory.mktemp("recordings")
    recorder = Recorder(path, "lathe-z", CHANNELS, 1e9, 5.0)
    for k in range(SECONDS * RATE_HZ):
        time_s = 1000.0 + k / RATE_HZ
        recorder.reading(Reading(time_s, {"nut_position_m": math.sin(time_s)}))
        if k % RATE_HZ == 0:
            recorder.reading(Reading(time_s, {"t1_degC": 20.0 + k / RATE_HZ}))
            recorder.tick(time_s)
    assert recorder.close(30.0)
    return path


def test_a_recording_has_its_first_and_last_time(folder):
    (found,) = recordings(folder, "lathe-z")
    assert found.from_s == 1000.0
    assert found.to_s == pytest.approx(1000.0 + SECONDS - 1 / RATE_HZ)
    assert recordings(folder, "mill-z") == []
    assert recordings(folder / "none", "lathe-z") == []


@pytest.mark.parametrize("block", [1 << 12, 1 << 16, 4 << 20])
def test_each_part_has_the_least_and_the_most_of_its_readings(folder, monkeypatch, block):
    monkeypatch.setattr(subject, "_BLOCK_BYTES", block)
    document = history(recordings(folder, "lathe-z"), START_S, START_S + 100.0, 50)
    time_s = 1000.0 + np.arange(SECONDS * RATE_HZ) / RATE_HZ
    part = np.floor((time_s - START_S) / 2.0)
    for k in range(50):
        position = np.sin(time_s[part == k])
        assert document["channels"]["nut_position_m"]["least"][k] == pytest.approx(position.min(), abs=1e-6)
        assert document["channels"]["nut_position_m"]["most"][k] == pytest.approx(position.max(), abs=1e-6)
        assert document["channels"]["nut_position_m"]["mean"][k] == pytest.approx(position.mean(), abs=1e-6)
        assert document["channels"]["t1_degC"]["mean"][k] == 220.5 + 2 * k
        assert document["channels"]["t1_degC"]["least"][k] == 220.0 + 2 * k
        assert document["channels"]["t1_degC"]["most"][k] == 221.0 + 2 * k
    assert document["time_s"][0] == START_S + 1.0


def test_spans_without_recordings_are_empty(folder):
    document = history(recordings(folder, "lathe-z"), 1590.0, 1610.0, 20)
    assert document["channels"]["t1_degC"]["least"][9] == 619.0
    assert document["channels"]["t1_degC"]["least"][10:] == [None] * 10
    assert history(recordings(folder, "lathe-z"), 1e6, 2e6, 10)["channels"] == {}


def test_an_axis_does_not_list_what_belongs_to_another(folder, tmp_path):
    (source,) = folder.glob("*.csv")
    stamp = source.name.removeprefix("lathe-z")
    for name in (f"lathe-z{stamp}", f"lathe-z2{stamp}", f"lathe-z-2{stamp}", f"lathe-z{stamp[:-4]}-kept.csv"):
        shutil.copy(source, tmp_path / name)
    (tmp_path / "lathe-z.notes.csv").write_text("time_s\n1.0\n", encoding="utf-8")
    names = {found.path.name for found in recordings(tmp_path, "lathe-z")}
    assert names == {f"lathe-z{stamp}", f"lathe-z{stamp[:-4]}-kept.csv"}
    assert [found.path.name for found in recordings(tmp_path, "lathe-z2")] == [f"lathe-z2{stamp}"]


DAY_S = 86_400
MOST_GATEWAY_kB = 150_000  # its budget


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """A day and a half at 0.5 Hz in two files: each temperature encodes its own time, the position swings."""
    path = tmp_path_factory.mktemp("days")
    for number, begin in enumerate((0, DAY_S)):
        time_s = 1000.0 + np.arange(begin, begin + DAY_S // (1 + number), 2)
        rows = "".join(f"{t!r},{t / 1000!r},{k % 7},,,\n" for k, t in enumerate(time_s.tolist()))
        file = path / f"lathe-z-1970010{number + 1}T001640Z.csv"
        file.write_text(f"time_s,t1_degC,nut_position_m,step,late_s,flags\n{rows}", encoding="utf-8")
    return path


def _whole(files, from_s: float, to_s: float, points: int, digests: Digests) -> dict[str, Any]:
    """Asked for until all is read."""
    while (document := history(files, from_s, to_s, points, digests))["read"] < 1.0:
        pass
    return document


@pytest.mark.parametrize("points", [2000, 400, 60])  # from the file itself, and from bins of both widths
def test_bins_of_days_agree_with_the_file(day, points):
    files, (from_s, to_s) = recordings(day, "lathe-z"), (1000.0, 1000.0 + 1.5 * DAY_S)
    document = _whole(files, from_s, to_s, points, Digests())
    exact = history(files, from_s, to_s, points)
    bin_s = COARSE_S if points == 60 else FINE_S
    for end in ("least", "mean", "most"):
        ours, theirs = (np.array(t["channels"]["t1_degC"][end]) for t in (document, exact))
        # a bin belongs to the part in which its middle is
        assert np.abs(ours - theirs).max() <= (bin_s / 2 + 2) / 1000
    assert set(document["channels"]["nut_position_m"]["most"]) == {6.0}


def test_a_long_history_arrives_bit_by_bit(day, monkeypatch):
    monkeypatch.setattr(subject, "_BLOCK_BYTES", 1 << 14)
    files, digests, now = recordings(day, "lathe-z"), Digests(), [0.0]

    def clock() -> float:
        now[0] += 0.1
        return now[0]

    shares, known = [], []
    while not shares or shares[-1] < 1.0:
        document = history(files, 1000.0, 1000.0 + 1.5 * DAY_S, 60, digests, clock)
        shares.append(document["read"])
        known.append(sum(x is not None for x in document["channels"]["t1_degC"]["least"]))
    assert len(shares) > 10
    assert shares == sorted(shares)
    assert known == sorted(known)
    assert known[0] < 10
    assert known[-1] == 60


def test_a_file_that_grows_is_read_on_and_one_that_is_new_from_its_beginning(day, tmp_path):
    source = day / "lathe-z-19700101T001640Z.csv"
    file = Path(shutil.copy(source, tmp_path))
    digests, span = Digests(), (1000.0, 1000.0 + 1.5 * DAY_S, 60)
    _whole(recordings(tmp_path, "lathe-z"), *span, digests)
    end = digests.of(file, COARSE_S).end
    assert end == file.stat().st_size
    with file.open("a", encoding="utf-8") as more:
        more.write("88000.0,999.0,0,,,\n88001.0,10")  # the second row is being written
    document = _whole(recordings(tmp_path, "lathe-z"), *span, digests)
    assert max(x for x in document["channels"]["t1_degC"]["most"] if x is not None) == 999.0
    assert digests.of(file, COARSE_S).end == end + len("88000.0,999.0,0,,,\n")
    file.write_text("time_s,t1_degC,step,late_s,flags\n1000.0,20.0,,,\n", encoding="utf-8")
    document = _whole(recordings(tmp_path, "lathe-z"), *span, digests)
    assert document["channels"]["t1_degC"]["most"][:2] == [20.0, None]


def test_bins_are_given_up_for_those_that_are_wanted(day):
    files, digests = recordings(day, "lathe-z"), Digests(most_bytes=1)
    for file in files:
        begin_s = file.from_s + 100.0  # the other file has ended by then
        document = _whole(files, begin_s, begin_s + 20_000.0, 500, digests)
        assert None not in document["channels"]["t1_degC"]["least"]
    assert [digests.of(file.path, FINE_S).size > 0 for file in files] == [False, True]
    assert _whole(files, 1000.0, 21_000.0, 500, digests)["channels"]["t1_degC"]["most"][0] < 1.05


def test_looking_back_does_not_make_the_process_large(day):
    """Nothing large is imported for it, and what is read is not kept."""
    script = (
        "import sys\nfrom pathlib import Path\nimport observer.gateway.process, observer.page.outlet\n"
        "from observer.page.history import Digests, history\nfrom observer.record.spans import recordings\n"
        f"files, digests = recordings(Path({str(day)!r}), 'lathe-z'), Digests()\n"
        f"while history(files, 1000.0, {1000.0 + 1.5 * DAY_S}, 800, digests)['read'] < 1.0: pass\n"
        "history(files, 1000.0, 60000.0, 2000)\nassert 'pandas' not in sys.modules\n"
        "print(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])"
    )
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, text=True)
    assert int(said.stdout) < MOST_GATEWAY_kB


@pytest.mark.parametrize(
    "span", [(2.0, 1.0, 5), (1.0, math.inf, 5), (math.nan, 1.0, 5), (1.0, 2.0, 0), (1.0, 2.0, 9999)]
)
def test_an_invalid_span_is_rejected(span):
    with pytest.raises(ValueError, match="no span"):
        history([], *span)
