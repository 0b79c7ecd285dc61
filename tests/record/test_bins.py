"""The page's view of the past: minimum, mean and maximum of each part of a span."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from observer.record.bins import history
from observer.record.step_store import Past
from tests.record.made import write_steps

SECONDS = 9000
START_S = 7199.75
TIME_S = 1.7e9 // 3600 * 3600 + np.arange(0.0, SECONDS, 0.5)
BEGIN_S = float(TIME_S[0])


@pytest.fixture(scope="module")
def past(tmp_path_factory) -> Past:
    """Two hours and a half: a temperature that rises, and a position that swings and was lost for a time."""
    folder = tmp_path_factory.mktemp("past")
    since_s = TIME_S - BEGIN_S
    lost = (since_s >= 3000.0) & (since_s < 3600.0)
    position = np.where(lost, math.nan, np.sin(since_s))
    write_steps(folder, "lathe-z", TIME_S, t1_degC=20.0 + since_s / 1000.0, nut_position_m=position)
    return Past(folder, "lathe-z")


def _whole(past: Past, from_s: float, to_s: float, points: int) -> dict:
    while (document := history(past, from_s, to_s, points))["read"] < 1.0:
        pass
    return document


@pytest.mark.parametrize(("points", "part_s"), [(50, 2.0), (60, 150.0)])  # from the steps, and from minutes
def test_each_part_has_the_least_mean_and_most_of_its_steps(past, points, part_s):
    from_s = BEGIN_S if part_s > 100.0 else BEGIN_S + 1000.25
    document = _whole(past, from_s, from_s + points * part_s, points)
    part = np.floor((TIME_S - from_s) / part_s)
    if part_s > 100.0:  # a minute belongs to the part in which its middle is
        part = np.floor((np.floor((TIME_S - BEGIN_S) / 60.0) * 60.0 + 30.0) / part_s)
    for k in range(points):
        temperature = 20.0 + (TIME_S[part == k] - BEGIN_S) / 1000.0
        column = document["channels"]["t1_degC"]
        expected = temperature.min(), temperature.mean(), temperature.max()
        assert (column["least"][k], column["mean"][k], column["most"][k]) == pytest.approx(expected, abs=1e-5)
    assert document["time_s"][0] == pytest.approx(from_s + part_s / 2, abs=1e-3)
    assert document["notes"] == []


@pytest.mark.parametrize("points", [600, 15])
def test_parts_without_a_value_are_empty(past, points):
    document = _whole(past, BEGIN_S, BEGIN_S + SECONDS, points)
    lost = slice(points * 3000 // SECONDS, points * 3600 // SECONDS)
    assert set(document["channels"]["nut_position_m"]["most"][lost]) == {None}
    assert None not in document["channels"]["t1_degC"]["most"]
    assert _whole(past, 1e6, 2e6, 10)["channels"] == {}


def test_a_long_span_is_read_file_by_file(past):
    now = [0.0]

    def clock() -> float:
        now[0] += 1.0
        return now[0]

    document = history(past, BEGIN_S, BEGIN_S + SECONDS, 10, clock)
    assert document["read"] == pytest.approx(1 / 3)
    assert document["channels"]["t1_degC"]["least"][0] is None
    assert document["channels"]["t1_degC"]["least"][-1] is not None  # the newest comes first


def test_a_damaged_file_is_left_out_with_a_sentence(tmp_path):
    write_steps(tmp_path, "lathe-z", TIME_S, t1_degC=20.0)
    first, *_ = sorted(tmp_path.iterdir())
    first.write_bytes(first.read_bytes()[:-100])
    document = _whole(Past(tmp_path, "lathe-z"), BEGIN_S, BEGIN_S + SECONDS, 10)
    (note,) = document["notes"]
    assert note.startswith(first.name)
    assert note.endswith("it is left out")
    assert document["channels"]["t1_degC"]["mean"][-1] == 20.0


@pytest.mark.parametrize(
    "span", [(2.0, 1.0, 5), (1.0, math.inf, 5), (math.nan, 1.0, 5), (1.0, 2.0, 0), (1.0, 2.0, 9999)]
)
def test_an_invalid_span_is_rejected(span):
    with pytest.raises(ValueError, match="no span"):
        history(None, *span)


MOST_OUTLETS_kB = 150_000
"""The budget of the outlets' process."""


def test_looking_back_does_not_make_the_process_large(past):
    script = (
        "from pathlib import Path\nimport observer.outlets.process, observer.outlets.page\n"
        "from observer.record.bins import history\nfrom observer.record.step_store import Past\n"
        f"past = Past(Path({str(past.folder)!r}), 'lathe-z')\n"
        f"for points in (15, 2000):\n    history(past, {BEGIN_S}, {BEGIN_S + SECONDS}, points)\n"
        "import sys\nassert 'pandas' not in sys.modules  # pyarrow would import it\n"
        "print(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, text=True)
    assert int(done.stdout) < MOST_OUTLETS_kB
