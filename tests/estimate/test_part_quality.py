"""Heats, field and thermal error each have a quality, on a machine with sensors on housings and nut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import observer
from campaigns.first_day.judge import along, write_machine
from observer import Estimates
from observer.frames import EstimateQuality

MACHINE, HOURS = 6, 0.2
ORDER = [quality.label for quality in EstimateQuality]


@pytest.fixture(scope="module")
def estimates(tmp_path_factory: pytest.TempPathFactory) -> Estimates:
    """Twelve minutes of stop and go after a cold start, by the configuration that `init` writes."""
    folder: Path = tmp_path_factory.mktemp("first-day")
    write_machine(folder, MACHINE, HOURS)
    return observer.load(folder / "config.toml").replay(folder / "log.csv.gz")


def ranks(estimates: Estimates, column: str) -> np.ndarray:
    return np.array([ORDER.index(label) for label in estimates[column].tolist()])


def test_an_uncertain_heat_leaves_field_and_error_good(estimates: Estimates) -> None:
    heat, error = ranks(estimates, "heat_quality"), ranks(estimates, "error_quality")
    assert np.mean(error == 0) > 0.95
    assert np.mean(heat == ORDER.index("starting")) > 0.5


def test_the_quality_of_an_estimate_is_the_worse_one_of_field_and_error(estimates: Estimates) -> None:
    worse = np.maximum(ranks(estimates, "field_quality"), ranks(estimates, "error_quality"))
    assert np.array_equal(ranks(estimates, "quality"), worse)


def test_nothing_is_good_before_readings_are_judged(estimates: Estimates) -> None:
    time_s = np.asarray(estimates["time_s"])
    begun = time_s - time_s[0] < 19.0
    for part in ("heat_quality", "field_quality", "error_quality"):
        assert (ranks(estimates, part)[begun] > 0).all()


def test_sensors_that_do_not_check_each_other_give_no_bound(estimates: Estimates) -> None:
    assert np.isnan(along(estimates, "error", "bound_um")).all()
    assert np.isnan(along(estimates, "field", "bound_K")).all()


def test_the_summary_tells_reasons_of_heats_from_those_of_the_error(estimates: Estimates) -> None:
    summary = estimates.summary
    assert any("heat of nut is still uncertain" in reason for reason in summary["heat_reasons"])
    assert not any("heat of nut" in reason for reason in summary["reasons"])
    assert summary["error_quality"]["good"] > summary["heat_quality"]["good"]
