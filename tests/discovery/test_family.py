"""What logs show of effects that tie, on machines of another program, and which effects may tie at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer import discover
from observer.discovery.candidates import Candidate, library
from observer.discovery.family import Member, tie_of, ties
from observer.fit.hypothesis import Fit, fit_effects, fit_null
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log
from tests.truth.machine.effects import Effect
from tests.truth.machine.exchange import RADIATION
from tests.truth.machine.generate import Case, machine_of, trace
from tests.truth.machine.generate import write_case as written
from tests.truth.machine.run import run_machine

WEAK = Effect("surface_convection", None, {"coefficient_W_m2K": 0.3})
STRONG = Effect("surface_convection", None, {"coefficient_W_m2K": 4.0})
GREY = Effect("radiation", None, {"emissivity": 0.03})
"""So weak that a film explains it as well; 0.05 is named, since readings of a screw this hot are believed."""
PLAUSIBLE_K = 67.5
"""How much warmer than the air a reading may be without `[limits]` of its own, if it warms gradually."""
SURFACE = {"surface_convection", "radiation", "natural_convection"}


def found(tmp_path: Path, case: Case) -> dict[str, Any]:
    logs = written(case, tmp_path / "logs")
    config = tmp_path / "logs" / "config.toml"
    return dict(discover(config, logs).document)


def radiated_W_m2K(case: Case) -> float:
    """What a machine's surface radiates, by its own book of energies, as a film on its mean rise; while any
    of its sensors reads what the program takes for plausible.
    """
    places_m, heat_W, rise_K = np.linspace(0.0, 1.0, 41), [], []
    for run in ("a", "b"):
        scene = trace(case, run).scene
        result = run_machine(scene.machine.physics, scene.schedule, places_m)
        above_K = result.section_degC[1:] - scene.schedule.air_degC[:, None]
        plausible = above_K[:, 2:-2].min(axis=1) < PLAUSIBLE_K
        heat_W.append(-result.book_J[plausible, RADIATION] / scene.schedule.step_s)
        rise_K.append(np.trapezoid(above_K, places_m, axis=1)[plausible])
    physics, q, driven = machine_of(case).physics, np.concatenate(heat_W), np.concatenate(rise_K)
    surface_m2 = np.pi * physics.diameter_m * physics.length_m
    return float(q @ driven / (driven @ driven) / surface_m2)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("hidden", [WEAK, GREY])
def test_a_weak_loss_of_the_surface_is_found_in_effect(tmp_path: Path, hidden: Effect) -> None:
    """A film, of whatever kind, or radiation: too weak to distinguish, with one figure for the heat lost."""
    case = Case("family.surface", (hidden,), 8, unknown=("film",))
    result = found(tmp_path, case)
    assert result["verdict"] == "ambiguous"
    members = {name for (name,) in result["alternatives"]}
    assert {"surface_convection", "radiation"} <= members <= SURFACE
    family = result["family"]
    assert (family["name"], set(family["members"]), family["beside"]) == ("surface_loss", members, [])
    low, high = family["effective"]["coefficient_W_m2K"]["ci95"]
    true_W_m2K = 0.3 if hidden is WEAK else radiated_W_m2K(case)
    assert low < true_W_m2K < high
    assert high - low < 0.5 * true_W_m2K


@pytest.mark.slow
@pytest.mark.nightly
def test_a_strong_loss_that_ties_with_none_has_its_own_name(tmp_path: Path) -> None:
    result = found(tmp_path, Case("family.surface", (STRONG,), 8))
    assert [e["kind"] for e in result["effects"]] == ["surface_convection"]
    assert result["family"] is None


# ---- which effects are one family, and what their figure is ----


@pytest.fixture(scope="module")
def null() -> Fit:
    """A bar that loses heat by a film its model lacks, at a rise of some 20 K, calibrated without."""
    bare = machine(surface={"convection_W_m2K": 0.0}, calibrate={"free": ["source.heater.scale"]})
    truth = machine(surface={"convection_W_m2K": 3.0})
    problem = problem_of(bare, [made_log(truth, 1, minutes=60.0, heater_W=4.0, speed_rpm=200.0)])
    return fit_null(problem, bare)


def candidate(null: Fit, name: str) -> Candidate:
    every = library(null.problem.config, null.problem.keys)
    return next(c for c in every if c.name == name)


def member(null: Fit, name: str) -> Member:
    """An effect alone, fitted in earnest."""
    own = candidate(null, name)
    config = null.config.model_copy(update={"effect": (own.effect(own.shapes[-1]),)})
    return Member.of(own, fit_effects(null.problem, config, own.parameters(0)))


@pytest.mark.parametrize(("growing", "share"), [("radiation", 0.05), ("natural_convection", 0.16)])
def test_a_film_is_its_own_figure_and_a_loss_that_grows_that_of_a_film(
    growing: str, share: float, null: Fit
) -> None:
    """At half the rise, natural convection has 16 % less film, which the fit to a constant film divides."""
    film, loss = member(null, "surface_convection"), member(null, growing)
    tie = tie_of([film, loss])
    assert tie is not None
    assert tie.family is not None
    assert tie.figure is not None
    assert tie.family.name == "surface_loss"
    alone = [tie_of([m]) for m in (film, loss)]
    figures = [t.figure for t in alone if t is not None and t.figure is not None]
    assert figures[0].value == pytest.approx(film.fit.values[0], rel=1e-9)
    assert figures[1].value == pytest.approx(figures[0].value, rel=share)
    assert tie.figure.value == pytest.approx(np.mean([f.value for f in figures]))
    assert tie.figure.ci95 == (min(f.ci95[0] for f in figures), max(f.ci95[1] for f in figures))
    assert tie.figure.ci95[0] < 3.0 < tie.figure.ci95[1]


@pytest.mark.parametrize(
    ("names", "family", "place"),
    [
        (("end_conduction at left", "attached_mass at left"), "end_loss", "left"),
        (("end_conduction at left", "end_conduction at right"), "heat_loss", None),
        (("end_conduction at left", "surface_convection"), "heat_loss", None),
        (("attached_mass at left", "attached_mass at right"), "body", None),
        (("motor_heat at right", "end_heat at right"), "end_source", "right"),
        (("motor_heat at right", "motor_heat at left"), None, None),
        (("end_conduction at left", "attached_mass at right"), None, None),
        (("radiation", "ambient_drift"), None, None),
    ],
)
def test_the_closest_family_that_all_share(
    null: Fit, names: tuple[str, str], family: str | None, place: str | None
) -> None:
    tie = tie_of([member(null, name) for name in names])
    if family is None:
        assert tie is None
        return
    assert tie is not None
    assert tie.family is not None
    assert (tie.family.name, tie.place, *(c.name for c in tie.members)) == (family, place, *names)


def test_sets_of_several_are_families_place_by_place(null: Fit) -> None:
    """What stands in every set needs none; one place without a family leaves the answer without."""
    film, grey, off, drift = (
        candidate(null, n) for n in ("surface_convection", "radiation", "sensor_bias at b", "ambient_drift")
    )

    def fit(*several: Candidate) -> Any:
        config = null.config.model_copy(update={"effect": tuple(c.effect(c.shapes[0]) for c in several)})
        parameters = [p for i, c in enumerate(several) for p in c.parameters(i)]
        return fit_effects(null.problem, config, parameters)

    sets, fits = [(off, film), (off, grey)], [fit(off, film), fit(grey, off)]
    first, second = ties(sets, fits)
    assert first.family is not None
    assert (first.family.name, [c.name for c in first.members]) == (
        "surface_loss",
        ["surface_convection", "radiation"],
    )
    assert (second.family, [c.name for c in second.members]) == (None, ["sensor_bias at b"])
    assert ties([*sets, (off, drift)], [*fits, fit(off, drift)]) == ()
    assert ties([(off, film), (grey,)], [fits[0], fit(grey)]) == ()
