"""A whole search that names two things, each proved on data held back: of a rod by another code."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.app import discover
from tests.truth.heated_rod import draw, write

pytestmark = pytest.mark.slow
SEED, HIDDEN = 9502, "block"


def test_a_block_is_named_and_the_thermocouple_that_is_off_beside_it(tmp_path: Path) -> None:
    """The heater's block is hidden, and t2 is the thermocouple that is off the most. Before each bias was
    judged by itself, a heat somewhere on the rod was chosen in its place, and had no proof.
    """
    rod = draw(SEED, HIDDEN)
    log = write(rod, SEED, tmp_path)
    found, result = discover(
        tmp_path / "config.toml", [log], tmp_path / "found", lambda *_: None, report=False
    )
    assert abs(rod.offset_K).argmax() == 1
    assert found.proof.unproved == ()
    assert result["verdict"] == "named"
    block, bias = result["effects"]
    assert (block["kind"], block["target"]) == ("attached_mass", "left")
    low, high = block["parameters"]["capacity_J_K"]["ci95"]
    assert low < rod.block_J_K < high
    assert (bias["kind"], bias["target"]) == ("sensor_bias", "t2")
    # against the mean of the others, which their own offsets of 0.3 K move by some tenths
    assert bias["parameters"]["offset_K"]["value"] == pytest.approx(rod.offset_K[1], abs=0.3)
