"""CAN recordings replay through the live decoding; one that was cut off says so."""

import can
import pytest

from observer.errors import LogError
from observer.process.memory import import_mf4
from tests.drivers.test_can import frame, settings

COUNT = 2000
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


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log", ".csv", ".trc"])
@pytest.mark.parametrize("share", [0.3, 0.814, 0.9999])
def test_a_recording_that_was_cut_off_is_not_taken_for_a_whole_one(record, suffix, share):
    path = record(suffix)
    data = path.read_bytes()
    cut = int(share * len(data))
    while data[cut - 1 : cut] == b"\n":  # a cut between two lines looks like the end
        cut -= 1
    path.write_bytes(data[:cut])
    got = []
    with pytest.raises(LogError, match=r"cut off|damaged") as caught:
        _collect(decoded(path), got)
    assert len(got) < COUNT
    positions_m = [reading.values["nut_position_m"] for reading in got]
    # no half frame became a reading
    assert positions_m == pytest.approx([i / COUNT for i in range(len(got))], abs=1e-9)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def _collect(readings, got):
    for reading in readings:
        got.append(reading)


def test_a_blf_whose_recorder_was_killed_is_reported(record):
    path = record(".blf")
    data = bytearray(path.read_bytes())
    data[16:24] = bytes(8)  # the length in the header is written last
    path.write_bytes(data)
    with pytest.raises(LogError, match="never completed"):
        list(decoded(path))


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
