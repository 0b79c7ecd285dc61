"""Heated rods: the truth against a closed form, and what a search makes of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from campaigns.rods.trial import outcome_of, tried
from tests.truth.heated_rod import draw, run


def test_the_truth_comes_to_the_steady_fall_along_a_rod_without_losses() -> None:
    """T(0) − T(L) = P L/(k A), with k of the mean temperature, once the rod's time constant is long past."""
    rod = replace(draw(1, "nothing"), film_W_m2K=0.0, exponent=0.0, late_s=0.0, power_W=2.0, lasts_s=60_000.0)
    time_s, cells = run(replace(rod, row_s=1000.0))
    heated = cells[time_s < 0.65 * rod.lasts_s][-1]
    section_m2 = np.pi * rod.diameter_m**2 / 4.0
    k = rod.conductivity_W_mK * (1.0 + 2e-4 * (heated.mean() - rod.air_degC))
    fall_K = heated[0] - rod.air_degC
    half_cell = 0.5 / len(heated)  # the first cell's middle is half a cell from the heated face
    assert fall_K == pytest.approx(2.0 * rod.length_m * (1 - half_cell) / (k * section_m2), rel=1e-3)


def test_a_block_takes_up_heat_before_the_rod_does() -> None:
    rod = replace(draw(1, "block"), late_s=0.0, lasts_s=600.0)
    bare = replace(rod, block_J_K=0.0)
    with_block, without = (run(each)[1][60:120, 0] for each in (rod, bare))
    assert (with_block < without - 1.0).all()


@pytest.mark.parametrize(
    ("verdict", "named", "sets", "outcome"),
    [
        ("named", ["attached_mass"], [], "right"),
        ("named", ["attached_mass", "attached_mass"], [], "wrong"),
        ("ambiguous", [], [["attached_mass at left"], ["end_conduction at left"]], "in the set"),
        ("ambiguous", [], [["end_conduction at left"]], "wrong"),
        ("none", [], [], "none"),
        ("unknown", [], [], "unknown"),
    ],
)
def test_an_answer_is_judged_by_what_was_hidden(
    verdict: str, named: list[str], sets: list[list[str]], outcome: str
) -> None:
    effects = [{"kind": kind, "target": "left"} for kind in named]
    assert outcome_of("block", {"verdict": verdict, "effects": effects, "alternatives": sets}) == outcome


@pytest.mark.slow
@pytest.mark.nightly
def test_the_capacity_of_a_heaters_block_is_named() -> None:
    (row,) = tried(("block", 3))
    assert row["outcome"] == "right"
