"""The campaign of the first day: what it makes of a machine, and how it counts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pyarrow
import pytest

import observer
from campaigns.first_day.configuration import write_configuration
from campaigns.first_day.judge import error_quality, row_of, write_machine
from campaigns.first_day.promise import DEVELOPMENT, JUDGED, PROMISES, bound_width, share, wideness, worst
from campaigns.first_day.report import promises_table
from tests.truth.first_day.machine import draw_machine


def test_a_shift_goes_through_the_product_as_init_configures_it(tmp_path: Path) -> None:
    [row] = row_of((2, 0.02), tmp_path)
    assert float(row["hours"]) == pytest.approx(0.02)
    assert 0 < int(row["steps"]) <= 72
    assert 0.0 < float(row["rms_um"]) < 30.0
    assert (tmp_path / "machine-2" / "truth.csv.gz").exists()
    table = promises_table([row])
    assert all(promise.words in table for promise in PROMISES)


@pytest.mark.parametrize("number", [1, 2, 6])
def test_a_configuration_has_what_the_user_of_the_machine_can_say(tmp_path: Path, number: int) -> None:
    nameplate = draw_machine(number).nameplate
    write_configuration(tmp_path / "config.toml", draw_machine(number))
    config = observer.load(tmp_path / "config.toml").config
    assert config.screw.length_m == nameplate.length_m
    assert config.source[0].stroke_m == nameplate.stroke_m
    assert config.supports is not None
    assert config.supports.first == nameplate.fixed
    assert config.compensation.enabled


def test_figures_are_sums_over_machines() -> None:
    rows = [
        {"good": "1", "steps": "4", "sigmas_um": "4", "squares_um2": "4", "bounds_um": "0", "late_s": "5"},
        {"good": "3", "steps": "4", "sigmas_um": "12", "squares_um2": "12", "bounds_um": "0", "late_s": ""},
    ]
    rows = [row | {"bounded_half_um": "0"} for row in rows]
    assert share(rows, "good", "steps") == 50.0
    assert wideness(rows) == 2.0
    assert bound_width(rows) == 0.0
    assert math.isinf(worst(rows, "late_s"))


@pytest.mark.parametrize(("more", "expected"), [({}, "starting"), ({"error_quality": ["good"]}, "good")])
def test_an_error_is_judged_by_its_own_quality_where_it_has_one(
    tmp_path: Path, more: dict[str, list[str]], expected: str
) -> None:
    write_machine(tmp_path, 1, 0.005)
    estimates = observer.load(tmp_path / "config.toml").replay(tmp_path / "log.csv.gz")
    table = pyarrow.table({"time_s": [0.0], "quality": ["starting"], **more})
    assert list(error_quality(replace(estimates, _table=table))) == [expected]


def test_judged_machines_are_none_of_those_for_development() -> None:
    assert not set(DEVELOPMENT) & set(JUDGED)
    assert len(JUDGED) == 24
