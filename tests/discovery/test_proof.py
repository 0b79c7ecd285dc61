"""Whole searches that prove what they name, or cannot: on rods and screws that another code simulates."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer import discover
from tests.truth import drawn_screw
from tests.truth.heated_rod import draw, write

pytestmark = pytest.mark.slow
PROVED, SEED, HIDDEN = 9502, 9526, "block"


def test_what_was_named_without_proof_is_unknown_and_the_rest_is_offered(tmp_path: Path) -> None:
    """Only the heater's block is hidden. A heat somewhere on the rod takes up what the block's form leaves of
    the fitted part of the log; it was named with it, and does not change what is held back.
    """
    log = write(draw(SEED, HIDDEN), SEED, tmp_path)
    discovery = discover(tmp_path / "config.toml", log)
    found, result = discovery._search.discovery, discovery.document
    assert [t.candidate.name for t in found.search.chosen] == ["attached_mass at left", "local_heat"]
    assert found.proof.unproved == ("local_heat",)
    assert (result["verdict"], result["effects"]) == ("unknown", [])
    assert result["reason"].startswith("local_heat would explain")
    assert result["partial"]["kind"] == "attached_mass"
    assert discovery.machine is None


def test_a_block_is_named_and_the_thermocouple_that_is_off_beside_it(tmp_path: Path) -> None:
    """The heater's block is hidden, and t2 is the thermocouple that is off the most. Before each bias was
    judged by itself, a heat somewhere on the rod was chosen in its place, and had no proof.
    """
    rod = draw(PROVED, HIDDEN)
    log = write(rod, PROVED, tmp_path)
    discovery = discover(tmp_path / "config.toml", log)
    found, result = discovery._search.discovery, discovery.document
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


@pytest.mark.parametrize("seed", [21, 23])
def test_tolerances_far_beyond_their_sigma_are_no_rival_of_a_loss(seed: int, tmp_path: Path) -> None:
    """Ten standard deviations of several tolerances would leave less of the gap than the loss does."""
    screw = drawn_screw.draw(seed, "end_conduction")
    logs = drawn_screw.write(screw, tmp_path, runs=2)
    result = discover(tmp_path / "config.toml", logs).document
    (effect,) = result["effects"]
    assert (effect["kind"], effect["target"]) == ("end_conduction", "left")
    low, high = effect["parameters"]["conductance_W_K"]["ci95"]
    assert low < screw.strength < high
