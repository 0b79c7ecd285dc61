"""σ over the standard shift without a log: against the filter itself, and what `check` makes of them."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from observer import installation
from observer.estimators import build_estimator
from observer.estimators.design.spread import spread
from observer.model.build import build_plant
from observer.model.cycle import standard_shift
from observer.report.sensitivity import KEYS, OF_NODES, OF_PARTS, advice, tolerances
from tests.logs.simulated import shift_log

CONFIG = Path(__file__).parents[2] / "config"


def demo(left=1.0, **estimator):
    """The demo's configuration with a step of a second, and a part of its tolerances."""
    config = installation.load(CONFIG / "demo.toml")
    given = {key: left * value for key, value in config.tolerance.model_dump().items()}
    return config.model_copy(
        update={
            "tolerance": config.tolerance.model_copy(update=given),
            "estimator": config.estimator.model_copy(update={"period_s": 1.0} | estimator),
        }
    )


def by_covariance(config):
    plant = build_plant(config, learns=True)
    found = spread(plant, config.estimator, standard_shift(config, plant), np.ones((1, plant.learnt)))
    return np.concatenate([found.heat_W[0], found.field_K, found.error_um])


def by_estimator(config):
    """Mean σ from ten minutes on of the estimator over a simulated log of the shift."""
    machine, u = shift_log(config)
    estimator = build_estimator(machine.plant, config.estimator)  # a bank adds what drifts make
    _, block = estimator.run(estimator.initial(), u)
    late = block.time_s >= 600.0
    sigmas = (block.heat_sigma_W, block.field_sigma_K, block.error_sigma_um)
    heat, field, error = (sigma[late].mean(axis=0) for sigma in sigmas)
    return np.array([*heat, field.mean(), error.mean()])


@pytest.mark.slow
@pytest.mark.parametrize("left", [1.0, 1e-3])
def test_the_filter_is_as_sure_as_its_covariance_says(left):
    """The two agree to some per cent: 10 s in one step against ten, and 8 phases of a sweep against all."""
    config = demo(left)
    np.testing.assert_allclose(by_covariance(config), by_estimator(config), rtol=0.1)


@cache
def of_demo():
    return tolerances(demo())


def test_each_key_has_its_row_and_none_makes_surer_by_being_unknown():
    rows = of_demo()["tolerances"]
    alone = [k for k in KEYS if k not in (*OF_NODES, OF_PARTS)]  # no nodes, no sensor that shows a part
    assert [row["key"] for row in rows] == ["as configured", *alone, "all"]
    assert [*KEYS, "heat_per_log"] == list(demo().tolerance.model_dump())  # which no estimator uses
    whole, best = rows[0], rows[-1]
    for row in rows[1:]:
        assert row["field_sigma_K"] <= whole["field_sigma_K"]
        assert row["error_sigma_um"] <= whole["error_sigma_um"]
        for name, sigma_W in row["heat_sigma_W"].items():
            assert best["heat_sigma_W"][name] <= sigma_W <= whole["heat_sigma_W"][name] * (1 + 1e-9)


def test_what_helps_most_is_named_with_its_remedy():
    """Without ends and film in doubt, thermocouples of 0.3 K are what field and error are unsure by."""
    first = of_demo()["improve_first"]
    assert first["field"]["key"] == first["error"]["key"] == "offset_K"
    rows = {row["key"]: row for row in of_demo()["tolerances"]}
    fall = 1 - rows["offset_K"]["error_sigma_um"] / rows["as configured"]["error_sigma_um"]
    assert first["error"]["fall"] == pytest.approx(fall)
    assert "in a bath" in advice(first)
    assert advice({"heat": None, "field": None}) == "no single tolerance costs much"


def test_a_machine_that_is_known_has_nothing_to_improve():
    found = tolerances(demo(0.0))
    assert found["improve_first"] == {"heat": None, "field": None, "error": None}
    sigma = {row["field_sigma_K"] for row in found["tolerances"]}
    assert len(sigma) == 1
    assert build_plant(demo(0.0), learns=True).parameters.kind.size == 0


@pytest.mark.parametrize("kind", ["kalman", "luenberger", "constant"])
def test_every_kind_of_estimator_has_its_own_sigma(kind):
    config = demo(kind="luenberger") if kind == "luenberger" else demo(engine="constant")
    config = demo() if kind == "kalman" else config
    sigma = by_covariance(config)
    assert np.isfinite(sigma).all()
    assert (sigma >= 0.95 * by_covariance(demo())).all()  # no gain does better than the filter's own


def test_without_expansion_there_is_no_error_to_be_unsure_of():
    config = demo()
    config = config.model_copy(update={"screw": config.screw.model_copy(update={"expansion_1_K": None})})
    found = tolerances(config)
    assert {row["error_sigma_um"] for row in found["tolerances"]} == {None}
    assert set(found["improve_first"]) == {"heat", "field"}


def electric(**source):
    """A heater of which the power is measured, or nothing is known."""
    config = installation.load(CONFIG / "demo.toml")
    band = {"name": "heater", "shape": "band", "from_m": 0.1, "to_m": 0.2} | source
    table = config.model_dump(exclude_unset=True, exclude={"source", "drivers"})
    return config.remade(table | {"source": [band]})


@pytest.mark.parametrize("law", [{"power_channel": "heater_W"}, {}, {"heat_W": 20.0}])
def test_a_machine_without_a_law_of_the_speed_has_a_shift_too(law):
    config = electric(**law)
    plant = build_plant(config, learns=True)
    rest, work = standard_shift(config, plant)[:2]
    constant = law.get("heat_W")
    assert rest.heat_W == [constant or 0.0]
    assert work.heat_W == [constant or 30.0]
    found = tolerances(config)
    assert np.isfinite([row["field_sigma_K"] for row in found["tolerances"]]).all()


def test_too_many_states_are_said_not_to_be_worked_out():
    config = demo()
    many = [s.model_copy(update={"name": f"s{i}"}) for i in range(14) for s in config.sensor]
    found = tolerances(config.model_copy(update={"sensor": tuple(many)}))
    assert (found["tolerances"], found["improve_first"]) == ([], {})
    assert "too many states" in found["tolerances_left_out"]
