"""CAN recordings replay through the live decoding; lost or uncertain parts are named."""

from datetime import datetime
from pathlib import Path

import can
import pytest

from drivers.recording import CanRecording
from observer.errors import LogError
from observer.process.memory import import_mf4
from tests.drivers.test_can import frame, settings

COUNT = 2000
DATA = Path(__file__).parent.parent / "data" / "can"
START_S = 1_700_000_000.0


def decoded(path):
    """The readings in a recording, as a replay takes them."""
    return settings().decodes(path, "axis")


@pytest.fixture
def record(tmp_path):
    def write(suffix):
        path = tmp_path / f"axis{suffix}"
        if suffix == ".mf4":
            import_mf4()
        with can.Logger(path) as log:
            for i in range(COUNT):
                log(frame(i / COUNT, 0.1 * (i * 7919 % 60_000), timestamp=START_S + 0.02 * i))
        return path

    return write


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log", ".csv", ".trc", ".asc.gz", ".mf4"])
def test_every_frame_comes_back_with_value_and_time(record, suffix):
    readings = list(decoded(record(suffix)))
    assert len(readings) == COUNT
    assert all(not reading.faults for reading in readings)
    positions_m = [reading.values["nut_position_m"] for reading in readings]
    assert positions_m == pytest.approx([i / COUNT for i in range(COUNT)], abs=1e-9)
    # these formats write the time of a frame in µs to ms, relative to a start written in ms
    since_s = [reading.time_s - readings[0].time_s for reading in readings]
    assert since_s == pytest.approx([0.02 * i for i in range(COUNT)], abs=1e-3)


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log"])
def test_times_are_absolute(record, suffix):
    first = next(iter(decoded(record(suffix))))
    assert first.time_s == pytest.approx(START_S, abs=1e-3)


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log", ".csv", ".trc", ".log.gz"])
@pytest.mark.parametrize("share", [0.3, 0.814, 0.9999])
def test_a_recording_that_was_cut_off_gives_its_whole_frames_and_a_doubt(record, suffix, share):
    path = record(suffix)
    data = path.read_bytes()
    cut = int(share * len(data))
    while data[cut - 1 : cut] == b"\n":  # a cut between two lines looks like the end
        cut -= 1
    path.write_bytes(data[:cut])
    recording = decoded(path)
    positions_m = [reading.values["nut_position_m"] for reading in recording]
    assert 0.5 * share * COUNT < len(positions_m) <= COUNT
    # no half frame became a reading
    assert positions_m == pytest.approx([i / COUNT for i in range(len(positions_m))], abs=1e-9)
    assert "cut off" in " ".join(recording.doubts) or "damaged" in " ".join(recording.doubts)
    assert "\n" not in " ".join(recording.doubts)


def test_forty_whole_frames_of_a_candump_log_survive_its_cut_last_line():
    recording = CanRecording(DATA / "cut.log", lambda frame: ({"id": float(frame.arbitration_id)}, {}))
    assert [reading.values["id"] for reading in recording] == [0x6F9] * 40
    assert recording.doubts == ["the last line (41) is cut off and left out"]


@pytest.mark.parametrize("suffix", [".asc", ".log"])
def test_one_damaged_line_costs_no_other_frame(record, suffix):
    path = record(suffix)
    lines = path.read_text().splitlines()
    cell = lines[1000].split()[-1]
    lines[1000] = lines[1000].replace(cell, "?" * len(cell))
    path.write_text("\n".join(lines) + "\n")
    recording = decoded(path)
    assert len(list(recording)) == COUNT - 1
    assert ["line 1001 cannot be read" in doubt for doubt in recording.doubts] == [True]


@pytest.mark.parametrize(
    "date",
    [
        "Mon Mar 2 08:00:00.000 am 2026",
        "Mo M\N{LATIN SMALL LETTER A WITH DIAERESIS}r 02 08:00:00.000 2026",
        "lun. mars 2 08:00:00.000 2026",
        "lun mars 2 08:00:00,000 2026",
        "lunes mar. 2 08:00:00 a. m. 2026",
        "2 marca 2026 08:00:00",
        "pon 02.03.2026 08:00:00",
        "2026-03-02 08:00:00.000",
    ],
)
def test_the_date_of_an_asc_is_read_in_the_language_of_its_computer(tmp_path, date):
    path, recording = asc_with(tmp_path, date)
    (reading,) = recording
    assert reading.time_s == datetime(2026, 3, 2, 8, 0, 1).timestamp(), path.read_text()
    assert recording.doubts == []


@pytest.mark.parametrize(
    "month",
    [
        "d\N{LATIN SMALL LETTER E WITH ACUTE}c.",
        "juil.",
        "juin",
        "ao\N{LATIN SMALL LETTER U WITH CIRCUMFLEX}t",
    ],
)
def test_months_with_accents_and_with_a_common_beginning_are_told_apart(tmp_path, month):
    number = {"d": 12, "j": 7, "a": 8}[month[0]] - (month == "juin")
    _, recording = asc_with(tmp_path, f"mer. {month} 2 08:00:00.000 2026")
    assert [reading.time_s for reading in recording] == [datetime(2026, number, 2, 8, 0, 1).timestamp()]


@pytest.mark.parametrize("date", ["pon o\u017eu 2 08:00:00 2026", "Mon 3/4/2026 08:00:00", "Mon Mar 2"])
def test_a_date_that_is_not_understood_is_a_doubt_and_not_1970_in_silence(tmp_path, date):
    _, recording = asc_with(tmp_path, date)
    assert [reading.time_s for reading in recording] == [1.0]
    assert "not understood" in recording.doubts[0]
    assert date in recording.doubts[0]


def asc_with(folder, date):
    """An `.asc` of one frame, a second after its start, and its recording."""
    path = folder / "axis.asc"
    data = " ".join(f"{byte:02X}" for byte in frame(0.5).data)
    path.write_text(
        f"date {date}\nbase hex  timestamps absolute\nno internal events logged\n"
        f"Begin Triggerblock {date}\n   1.000000 1  201             Rx   d 8 {data}\nEnd TriggerBlock\n",
        encoding="utf-8",
    )
    return path, decoded(path)


def test_a_blf_whose_recorder_was_killed_is_read_with_a_doubt(record):
    path = record(".blf")
    data = bytearray(path.read_bytes())
    data[16:24] = bytes(8)  # the length in the header is written last
    path.write_bytes(data)
    recording = decoded(path)
    assert len(list(recording)) == COUNT
    assert "never completed" in recording.doubts[0]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.asc", None, "no such file"),
        ("axis.xyz", b"", "not a CAN recording"),
        ("axis.blf", b"not a log at all" * 20, "not a CAN recording"),
        ("axis.blf", b"LOGG", "not a CAN recording"),
    ],
)
def test_files_that_are_no_recording(tmp_path, name, content, words):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LogError, match=words):
        list(decoded(path))
