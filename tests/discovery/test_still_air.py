"""Searches for a film that grows with the screw's own rise, on machines that other programs simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from observer import discover
from tests.truth import drawn_screw
from tests.truth.machine.effects import Effect
from tests.truth.machine.generate import Case, write_case

pytestmark = pytest.mark.slow


def searched(folder: Path, logs: list[Path]) -> dict[str, Any]:
    return dict(discover(folder / "config.toml", logs).document)


@pytest.mark.parametrize("seed", [501, 513])
def test_a_screw_in_still_air_is_named_with_its_coefficient(seed: int, tmp_path: Path) -> None:
    """The screw has no other film, so the search lowers the configured one to nothing as well."""
    screw = drawn_screw.draw(seed, "still_air")
    result = searched(tmp_path, drawn_screw.write(screw, tmp_path, runs=2))
    (effect,) = result["effects"]
    assert effect["kind"] == "natural_convection"
    at_10_K_W_m2K = screw.bar.convection_W_m2K * (10.0 / drawn_screw.REFERENCE_K) ** screw.strength
    low, high = effect["parameters"]["coefficient_W_m2K"]["ci95"]
    assert low < at_10_K_W_m2K < high


@pytest.mark.parametrize(("hidden", "verdict"), [("nothing", "none"), ("speed_convection", "named")])
def test_a_film_that_does_not_grow_with_the_rise_is_not_called_still_air(
    hidden: str, verdict: str, tmp_path: Path
) -> None:
    result = searched(tmp_path, drawn_screw.write(drawn_screw.draw(501, hidden), tmp_path, runs=2))
    assert result["verdict"] == verdict
    assert [e["kind"] for e in result["effects"]] == ([] if hidden == "nothing" else [hidden])


@pytest.mark.nightly
def test_still_air_beside_a_film_is_named_on_a_hot_machine(tmp_path: Path) -> None:
    still_air = Effect("natural_convection", None, {"coefficient_W_m2K": 6.0})
    result = searched(tmp_path, write_case(Case("still_air", (still_air,), 31, "hot"), tmp_path))
    (effect,) = result["effects"]
    assert effect["kind"] == "natural_convection"
    low, high = effect["parameters"]["coefficient_W_m2K"]["ci95"]
    assert low < still_air["coefficient_W_m2K"] < high
