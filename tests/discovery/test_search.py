"""The search on a small bar: what it names, what it leaves out, and what counts as the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.config.effects.catalogue import BY_KIND, KINDS
from observer.config.machine import Config
from observer.discovery.candidates import Candidate, library
from observer.discovery.discover import Discovery, discover
from observer.discovery.search import FittedCandidate, held_out, same_physics
from observer.errors import LogError
from observer.fit.hypothesis import Fit
from observer.fit.parameters import free_keys
from observer.frames import FloatArray
from observer.installation import load
from observer.model.build import build_plant
from tests.discovery.written import CONFIG, estimated, fit, left, problem, trial
from tests.logs.machines import machine
from tests.logs.simulated import made_log

BIAS = {"kind": "sensor_bias", "target": "b", "offset_K": 0.8}


def found_in(config: Config, **hidden: Any) -> Discovery:
    truth = machine(**hidden)
    return discover(config, [[made_log(truth, seed, minutes=90.0)] for seed in range(3)])


def named(found: Discovery) -> list[str]:
    return [" and ".join(c.name for c in each) for each in found.verdict.sets]


def test_a_bias_is_named_and_a_bar_as_modelled_is_not() -> None:
    found = found_in(machine(), effect=[BIAS])
    assert (found.verdict.kind, named(found)) == ("named", ["sensor_bias at b"])
    assert found.verdict.fit.values[0] == pytest.approx(0.8, abs=0.02)
    plain = found_in(machine())
    assert plain.search.chosen == ()
    assert plain.verdict.kind == "not_identifiable"  # one speed only
    assert "1000 rpm only" in plain.verdict.reason


def test_a_proof_without_a_reading_is_refused() -> None:
    config = machine()
    log = made_log(config, 0)
    fresh, late = log.fresh.copy(), log.time_s > 0.6 * log.time_s[-1]
    sensors = [i for i, name in enumerate(log.channels) if name.endswith("_degC")]
    fresh[np.ix_(late, sensors)] = False
    values = np.where(fresh, log.values, np.nan)
    broken = replace(log, fresh=fresh, values=values, quality=np.where(fresh, log.quality, 1))
    with pytest.raises(LogError, match="kept as proof and holds no usable reading"):
        discover(config, [[broken]])


@pytest.mark.parametrize("kind", KINDS)
def test_without_leaves_out_its_kind_and_no_other(kind: str) -> None:
    config = machine()
    keys = free_keys(config)
    whole, less = library(config, keys), library(config, keys, (kind,))
    assert [c for c in whole if c.kind != kind] == list(less)
    assert kind not in {c.kind for c in less}


def test_heats_that_are_one_with_others_have_no_effect_of_their_own() -> None:
    """A plant refuses what acts on one of several sources that have one heat, so none of it is tried."""
    kim = load(Path(__file__).parents[2] / "config" / "kim-screw-one.toml")
    tried = library(kim, free_keys(kim))
    assert {c.target for c in tried if c.of.targets == "source"} == {"nut"}
    for candidate in tried:
        effect = candidate.effect(candidate.shapes[0])
        build_plant(kim.model_copy(update={"effect": (effect,)}))


def spot(part: float) -> dict[str, Any]:
    return {"kind": "local_heat", "position_m": part * CONFIG.screw.length_m, "heat_W": 1.0}


def stretch(from_part: float, to_part: float) -> dict[str, Any]:
    """By parts of the screw's length."""
    from_m, to_m = (part * CONFIG.screw.length_m for part in (from_part, to_part))
    return {"kind": "uneven_convection", "from_m": from_m, "to_m": to_m, "extra_W_m2K": 5.0}


@pytest.mark.parametrize(
    ("simple", "rich", "same"),
    [
        (("motor_heat", "left"), spot(0.03), True),
        (("motor_heat", "right"), spot(0.97), True),
        (("motor_heat", "right"), spot(0.03), False),
        (("motor_heat", "left"), spot(0.5), False),
        (("end_conduction", "left"), spot(0.03), False),
        (("end_conduction", "left"), stretch(0.0, 0.06), True),
        (("end_conduction", "right"), stretch(0.95, 1.0), True),
        (("end_conduction", "left"), stretch(0.0, 0.4), False),
        (("surface_convection", None), stretch(0.0, 1.0), True),
        (("surface_convection", None), stretch(0.0, 0.8), False),
        (("end_conduction", "left"), stretch(0.0, 1.0), False),
    ],
)  # fmt: skip
def test_a_place_at_an_end_is_that_end(simple: tuple[str, str], rich: dict[str, Any], *, same: bool) -> None:
    kind, target = simple
    plain, place = (trial(target, 1.0, left(0.3, rich), of) for of in (kind, rich["kind"]))
    assert same_physics(plain, place) is same


# ---- data held out ----


def on_two_folds(residual: FloatArray, column: FloatArray) -> Fit:
    """A fit with one parameter on two folds of equal length, without tolerances."""
    return fit(problem(np.repeat([0, 1], len(residual) // 2)), residual, column=column)


def test_what_only_one_fold_shows_explains_nothing_that_is_held_out() -> None:
    """A parameter that fits a fold by itself has learnt nothing of it from the others."""
    once = np.array([1.0, -2.0, 1.5, 0.0, 0.0, 0.0])
    assert held_out(on_two_folds(0.3 * once, once)) == pytest.approx(0.09 * float(once @ once), rel=1e-12)


def test_what_both_folds_show_alike_goes_and_what_they_contradict_gets_worse() -> None:
    both = np.array([1.0, -2.0, 1.5, -1.0, 2.0, 0.5])
    assert held_out(on_two_folds(0.3 * both, both)) == pytest.approx(0.0, abs=1e-20)
    against = 0.3 * both * np.repeat([1.0, -1.0], 3)
    assert held_out(on_two_folds(against, both)) == pytest.approx(4 * float(against @ against), rel=1e-12)


# ---- two effects of a kind ----


SHARED = ("capacity_J_K", "conductance_W_K")


def bodies_beside_each_other(half_width: list[float]) -> Fit:
    """A fit of a body at the heater that takes of its heat, and of a plain one at the left end."""
    body = {"kind": "attached_mass", "capacity_J_K": 400.0, "conductance_W_K": 3.0}
    config = machine(effect=[body | {"target": at} for at in ("heater", "left")])
    numbers = [(0, key) for key in (*SHARED, "heat_share")] + [(1, key) for key in SHARED]
    return estimated(config, [400.0, 3.0, 0.3, 400.0, 3.0], half_width, numbers)


def body(at: str, *keys: str) -> Candidate:
    of = BY_KIND["attached_mass"]
    return Candidate(of, at, (), {key: of.parameters[key] for key in keys})


def test_a_second_body_is_judged_by_its_own_parameters_whatever_form_the_first_has() -> None:
    """A heat that comes late against its law is taken for two bodies: one with more parameters, one plain."""
    plain, rich = body("left", *SHARED), body("heater", *SHARED, "heat_share")
    wide, narrow = (bodies_beside_each_other(half) for half in ([100.0, 1.0, 0.1, 9e4, 1.0], [1.0] * 5))
    assert not FittedCandidate(plain, wide, 100.0, 30.0, 0.5).bounded  # its own capacity has no upper bound
    assert FittedCandidate(rich, wide, 100.0, 30.0, 0.5).bounded
    assert FittedCandidate(plain, narrow, 1.0, 1.0, 0.5).significant
