"""Effects that change the machine itself, put in place in its configuration."""

from __future__ import annotations

import math

import pytest

from observer.installation import parse
from observer.model.realise import realise
from tests.logs.machines import table


def end_with(conductance_W_K: float) -> tuple[str, float | None]:
    """What a left end becomes that was insulated and conducts; its kind and its film."""
    described = {"kind": "end_conduction", "target": "left", "conductance_W_K": 1.0}
    config = parse(table(effect=[described], boundary={"left": {"kind": "insulated"}}))
    fitted = config.effect[0].model_copy(
        update={"conductance_W_K": conductance_W_K}
    )  # as a fit does, unchecked
    end = realise(config.model_copy(update={"effect": (fitted,)})).config.boundary.left
    return end.kind, end.coefficient_W_m2K


def test_a_conductance_is_a_film_over_the_end() -> None:
    diameter_m = parse(table()).screw.diameter_m
    kind, film_W_m2K = end_with(0.1)
    assert kind == "convective"
    assert film_W_m2K == pytest.approx(0.1 / (math.pi * diameter_m**2 / 4))


def test_a_conductance_that_a_fit_has_driven_to_nothing_is_none() -> None:
    """A film of 5e-13 is none that a table could hold: a search once ended on it."""
    assert end_with(5e-16) == ("insulated", None)
