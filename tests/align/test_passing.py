"""A displacement that is read along a nut's way counts at the places that the nut passes."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.align.aligner import Aligner, AlignPlan, frames_of_log
from observer.align.passing import PASSING_S
from observer.config.machine import Config
from observer.errors import UserError
from observer.estimate.pipeline import MachineModel
from observer.files.logs import Log
from observer.frames import Reading
from observer.installation import parse
from observer.library.replaying import estimates_of_log
from tests.logs.machines import table
from tests.model.test_displacement import simulated

STROKE_m, SPEED_m_s, PLAY_um = (0.1, 0.3), 0.05, 5.0
PLACES_m = [0.12, 0.16, 0.2, 0.24, 0.28]


def _with_scale(**changes: Any) -> Config:
    base = table()
    scale = {"name": "scale", "kind": "displacement", "channel": "scale_um", "along": "nut"}
    nut = {
        "name": "nut", "shape": "nut", "length_m": 0.02, "stroke_m": STROKE_m, "position_channel": "nut_m",
        "power_channel": "nut_W",
    }  # fmt: skip
    screw = {**base["screw"], "expansion_1_K": 11.8e-6}
    sensors = [*base["sensor"], scale | changes]
    return parse({**base, "screw": screw, "source": [*base["source"], nut], "sensor": sensors})


def _to_and_fro_m(time_s: Any) -> Any:
    """Where the nut is."""
    reach_m = STROKE_m[1] - STROKE_m[0]
    phase_m = np.asarray(time_s) * SPEED_m_s % (2.0 * reach_m)
    return STROKE_m[0] + np.where(phase_m <= reach_m, phase_m, 2.0 * reach_m - phase_m)


def _read_um(time_s: Any) -> Any:
    """What the scale shows: the error grows along the screw and with time, and on its way back is play."""
    back = np.asarray(time_s) * SPEED_m_s % 0.4 > 0.2
    return 1000.0 * _to_and_fro_m(time_s) ** 2 + 0.1 * np.asarray(time_s) - PLAY_um * back


def _log(config: Config, every_s: float, seconds: float = 300.0) -> Log:
    time_s = np.arange(0.0, seconds, every_s)
    known = {"nut_m": _to_and_fro_m(time_s), "scale_um": _read_um(time_s)}
    names = tuple(c for c in config.channels if c not in config.derived_channels)
    values = np.column_stack([known.get(name, np.full(len(time_s), 20.0)) for name in names])
    return Log(Path("scale.csv"), time_s, names, values)


def _assert_at_its_places(found: dict[float, list[tuple[float, float]]], off_um: float) -> None:
    for place_m, readings in found.items():
        times_s, values_um = np.transpose(readings)
        assert np.diff(times_s).min() >= PASSING_S - 1.0  # a value stands in the row after its passage
        np.testing.assert_allclose(values_um, 1000.0 * place_m**2 + 0.1 * times_s, atol=off_um)


def _of_log(config: Config, log: Log) -> dict[float, list[tuple[float, float]]]:
    place_m = {s.channel: float(s.position_m or 0.0) for s in config.sensor if s.along}
    found: dict[float, list[tuple[float, float]]] = {x_m: [] for x_m in place_m.values()}
    for frames in frames_of_log(log, AlignPlan.of(config)):
        for j, name in enumerate(frames.channels):
            if name in place_m:
                fresh = frames.fresh[:, j]
                found[place_m[name]] += zip(frames.time_s[fresh], frames.values[fresh, j], strict=True)
    return found


@pytest.mark.parametrize(("every_s", "off_um"), [(0.05, 0.1), (0.2, 0.2)])
def test_in_a_log_it_is_read_at_each_place_on_the_way_out(every_s: float, off_um: float) -> None:
    config = _with_scale()
    assert [s.position_m for s in config.sensor if s.along] == PLACES_m
    _assert_at_its_places(_of_log(config, _log(config, every_s)), off_um)


def test_in_rows_too_rare_for_a_passage_it_is_read_near_the_places() -> None:
    config = _with_scale()
    found = _of_log(config, _log(config, 0.73, 3000.0))  # 37 mm apart, of 20 mm allowed
    first, *others = PLACES_m
    assert not found.pop(first)  # between it and where the nut has turned lies less than a row's way
    assert all(len(found[place_m]) > 5 for place_m in others)
    _assert_at_its_places(found, 1.75)  # 3 mm of a slope of 0.56 µm/mm at most, and a row of drift


def test_live_nut_and_scale_may_come_in_messages_of_their_own() -> None:
    config = _with_scale()
    aligner = Aligner(AlignPlan.of(config))
    place_m = {s.channel: float(s.position_m or 0.0) for s in config.sensor if s.along}
    found: dict[float, list[tuple[float, float]]] = {x_m: [] for x_m in place_m.values()}
    for k in range(6000):
        at_s = 0.05 * k
        readings = [Reading(at_s, {"nut_m": float(_to_and_fro_m(at_s))})]
        readings.append(Reading(at_s + 0.02, {"scale_um": float(_read_um(at_s + 0.02))}))
        for reading in readings:
            news = aligner.news_of(reading)
            assert news[-1] is reading
            for one in news[:-1]:
                assert at_s - 0.15 < one.time_s <= reading.time_s
                ((name, value),) = one.values.items()
                found[place_m[name]].append((one.time_s, value))
    _assert_at_its_places(found, 0.1)


@pytest.mark.parametrize("broken", ["nut_m", "scale_um"])
def test_what_is_faulty_says_nothing(broken: str) -> None:
    aligner = Aligner(AlignPlan.of(_with_scale()))
    for k in range(400):
        values = {"nut_m": float(_to_and_fro_m(0.05 * k)), "scale_um": 3.0}
        (only,) = aligner.news_of(Reading(0.05 * k, values | {broken: math.nan}, {broken: "timeout"}))
        assert broken in only.values


def test_a_simulated_log_holds_what_the_scale_shows_at_the_nut() -> None:
    config = _with_scale()
    found = simulated(config, _log(config, 0.5))
    assert "scale_1_um" not in found
    assert {"scale_um", "nut_m"} <= set(found)
    assert np.ptp(found["scale_um"]) > 0.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"along": "bearing"}, 'along names "bearing", which is no nut with stroke_m and position_channel'),
        ({"occasional": True}, "remove occasional"),
        ({"position_m": 0.2, "along": None, "kind": "temperature", "occasional": True}, "has no meaning"),
        ({"channel": "scale"}, "is to end in its unit"),
        ({"position_m": 0.2}, "remove position_m, or along"),
    ],
)
def test_what_it_cannot_be_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        _with_scale(**changes)


def test_drivers_deliver_the_scale_and_not_its_places() -> None:
    config = _with_scale()
    assert config.derived_channels == {f"scale_{k}_um" for k in range(1, 6)}
    assert "scale_um" in config.channels


@pytest.mark.parametrize(
    ("every_s", "low_m", "said"),
    [
        (0.2, 0.1, None),
        (
            2.9,
            0.1,
            "at any of its places.*moves 1[34]. mm.*most 20 mm.*every 0.4.? s or faster, .* every 2.9 s",
        ),
        (0.2, 0.17, r"never read at 0\.12, 0\.16 m.*does not pass them"),
    ],
)
def test_a_place_that_is_never_read_is_not_good_and_a_sentence_says_why(
    every_s: float, low_m: float, said: str | None
) -> None:
    """The nut goes too far from row to row, or not to the places near x = 0."""
    config = _with_scale()
    log = _log(config, every_s)
    nut_m = log.values[:, log.channels.index("nut_m")]
    nut_m[:] = np.maximum(nut_m, low_m)
    estimates = estimates_of_log(log, config, MachineModel.of(config))
    summary = estimates.summary
    doubted = [sentence for sentence in summary["doubts"] if sentence.startswith("scale_um")]
    assert len(doubted) == (said is not None)
    assert said is None or re.search(said, doubted[0])
    assert not any("missing" in reason for reason in summary["reasons"]), "which is no fault"
    for k, place_m in enumerate(PLACES_m, 1):
        read = np.isfinite(estimates[f"innovation_scale_{k}_um"])
        assert read.any() == (every_s < 1.0 and place_m > low_m)
        missing = np.asarray(estimates[f"quality_scale_{k}"]) == "missing"
        np.testing.assert_array_equal(missing, np.cumsum(read) == 0)
