"""What a service has recorded lately, as the frames that it saw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from observer.config.publishing import RecordSettings
from observer.errors import ConfigError, LogError
from observer.record.recent import duration_s, stretches
from observer.record.retention import START_SUFFIX
from tests.logs.recordings import CHANNELS, joined, plan, recorded, same_bits, tick_row

BEGIN_S = 1.79e9
PLAN = plan(period_s=1.0)
HOUR_S = 3600.0


def _rows(hours: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Rows one a second, a cell of ten missing."""
    rng = np.random.default_rng(seed)
    values = 20.0 + rng.normal(size=(round(hours * HOUR_S), len(CHANNELS)))
    values[rng.random(values.shape) < 0.1] = np.nan
    values[400::400] = np.nan  # nothing was read just after a file was full: what was known before holds
    return np.arange(1.0, len(values) + 1), values


def _record(folder: Path, begin_s: float, hours: float = 0.5, rotate_rows: float = np.inf) -> list:
    return recorded(
        folder, PLAN, begin_s, *_with_channels(*_rows(hours)), rotate_rows=rotate_rows, name="m-x"
    )


def _with_channels(time_s, values):
    return time_s, CHANNELS, values


def _found(folder: Path, last_s: float = 1e6) -> list:
    return stretches(RecordSettings(directory=folder), "m-x", PLAN, last_s)


@pytest.mark.parametrize(
    ("text", "seconds"), [("90min", 5400.0), ("8h", 28_800.0), ("2d", 172_800.0), (" 1.5 h", 5400.0)]
)
def test_a_duration_has_a_unit_of_minutes_hours_or_days(text, seconds):
    assert duration_s(text) == seconds


@pytest.mark.parametrize(
    "text", ["", "8", "h", "-1h", "0h", "8 hours", "1e3h", "nan h", "8h30min", "9" * 40 + "h"]
)
def test_an_invalid_duration_is_reported(text):
    with pytest.raises(ConfigError, match=r"--recent: .* is not a duration; give"):
        duration_s(text)


def test_files_that_were_full_are_one_stretch_of_the_same_frames(tmp_path):
    seen = _record(tmp_path, BEGIN_S, rotate_rows=400)
    assert len(list(tmp_path.glob("*.csv"))) == 5
    (stretch,) = _found(tmp_path)
    assert same_bits(joined([stretch.frames]), joined(seen))


def test_only_the_last_hours_count_and_the_frames_stay_those_that_were_seen(tmp_path):
    seen = _record(tmp_path, BEGIN_S, rotate_rows=400)
    (stretch,) = _found(tmp_path, 1000.0)
    assert stretch.end_s - stretch.begin_s == pytest.approx(1000.0, abs=1.0)
    late = joined(seen)["values"][-len(stretch.frames) :]
    assert stretch.frames.values.tobytes() == late.tobytes()  # what was known before the cut is known


def test_a_night_parts_two_stretches(tmp_path):
    _record(tmp_path, BEGIN_S)
    _record(tmp_path, BEGIN_S + 10 * HOUR_S)
    first, second = _found(tmp_path)
    assert first.end_s == pytest.approx(BEGIN_S + 0.5 * HOUR_S, abs=1.0)
    assert second.begin_s == pytest.approx(BEGIN_S + 10 * HOUR_S, abs=2.0)
    assert "2026-09-21 14:13 to 2026-09-21 14:43 UTC" in str(first)
    (only,) = _found(tmp_path, 2 * HOUR_S)  # by the recordings' own times
    assert only.begin_s == second.begin_s


def test_a_restart_of_ten_seconds_parts_nothing_but_forgets_what_was_read(tmp_path):
    _record(tmp_path, BEGIN_S)
    again_s = BEGIN_S + 0.5 * HOUR_S + 10.0
    seen = _record(tmp_path, again_s)
    next(iter(tmp_path.glob("*1443*.csv"))).with_suffix(START_SUFFIX).write_bytes(b"")
    (stretch,) = _found(tmp_path)
    assert len(stretch.frames) == 2 * 1800
    assert stretch.frames.values[1800:].tobytes() == joined(seen)["values"].tobytes()
    assert stretch.frames.dt_s[1800] == pytest.approx(11.0)


def test_a_reset_of_the_estimator_parts_two(tmp_path):
    _record(tmp_path, BEGIN_S)
    (path,) = tmp_path.glob("*.csv")
    lines = path.read_bytes().splitlines(keepends=True)
    at = 1801  # after 900 ticks
    time_s = float(lines[at].split(b",")[0]) - 1e-3
    lines.insert(at, f"{time_s!r},{',' * len(CHANNELS)},,!reset=done (by anna)\n".encode())
    path.write_bytes(b"".join(lines))
    first, second = _found(tmp_path)
    assert (len(first.frames), len(second.frames)) == (900, 900)
    assert second.frames.dt_s[0] == 0.0


def test_a_row_that_is_being_written_is_left_out(tmp_path):
    _record(tmp_path, BEGIN_S)
    (path,) = tmp_path.glob("*.csv")
    path.write_bytes(path.read_bytes()[:-7])
    (stretch,) = _found(tmp_path)
    assert len(stretch.frames) == 1800 - 1


def test_a_file_that_has_only_begun_is_left_out(tmp_path):
    _record(tmp_path, BEGIN_S)
    (path,) = tmp_path.glob("*.csv")
    head = path.read_bytes().split(b"\n")[0]
    for text, stamp in (
        (b"", "20270101T000000Z"),
        (head, "20270101T000001Z"),
        (head + b"\n", "20270101T000002Z"),
    ):
        (tmp_path / f"m-x-{stamp}.csv").write_bytes(text)
    (stretch,) = _found(tmp_path)
    assert len(stretch.frames) == 1800


def test_a_clock_that_was_set_back_leaves_what_was_before_out(tmp_path):
    _record(tmp_path, BEGIN_S)
    (path,) = tmp_path.glob("*.csv")
    path.rename(tmp_path / "m-x-20260101T000000Z.csv")
    _record(tmp_path, BEGIN_S - 20 * 86_400.0)
    (stretch,) = _found(tmp_path)
    assert stretch.begin_s < BEGIN_S - 86_400.0


def test_recordings_of_another_service_are_not_taken(tmp_path):
    _record(tmp_path, BEGIN_S)
    (path,) = tmp_path.glob("*.csv")
    path.rename(tmp_path / path.name.replace("m-x", "m-y"))
    with pytest.raises(LogError, match="no service called m-x has recorded anything there"):
        _found(tmp_path)


def test_too_short_a_span_is_reported(tmp_path):
    _record(tmp_path, BEGIN_S, hours=0.05)
    with pytest.raises(LogError, match="lasts 179 s, and 300 s are needed; ask for a longer time"):
        _found(tmp_path)


def test_missing_recordings_are_reported(tmp_path):
    with pytest.raises(ConfigError, match=r"no record\.directory; add \[record\], or name logs"):
        stretches(RecordSettings(), "m-x", PLAN, 1e6)
    with pytest.raises(LogError, match="cannot be read"):
        _found(tmp_path / "nowhere")


def test_a_recording_without_a_channel_is_reported(tmp_path):
    _record(tmp_path, BEGIN_S)
    (path,) = tmp_path.glob("*.csv")
    path.write_bytes(path.read_bytes().replace(b"nut_position_m", b"something_else", 1))
    with pytest.raises(LogError, match='"nut_position_m" is missing'):
        _found(tmp_path)


def test_a_tick_alone_is_a_frame(tmp_path):
    """A machine whose wires are dead is recorded too, and is no run of a machine."""
    rows = b"".join(tick_row(BEGIN_S + k, CHANNELS) for k in range(1000))
    head = b"time_s,t1_degC,t2_degC,nut_position_m,step,late_s,flags\n"
    (tmp_path / "m-x-20260921T141320Z.csv").write_bytes(head + rows)
    (stretch,) = _found(tmp_path)
    assert np.isnan(stretch.frames.values).all()
