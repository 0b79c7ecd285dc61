"""What `check` says of the least fault that is noticed: by the filters themselves, and in words."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from observer import installation
from observer.config.candidates import SensorCandidate
from observer.config.machine import Config
from observer.estimators.bank import Bank
from observer.estimators.fault_search import MISFIT
from observer.estimators.packing import Running
from observer.installation import Installation, parse
from observer.installation.first_configuration import answers
from observer.installation.first_template import filled
from observer.kernels.screening import DRIFT_K_S, JUMP_SIGMA
from observer.model.build import build_plant
from observer.report import check, sensitivity
from observer.report.check import findings
from observer.report.check_text import _least, as_text
from observer.report.sensitivity import buys, detectable
from tests.logs.simulated import shift_log

ROOT = Path(__file__).parents[2]
NAMES = [f"t{i}" for i in range(1, 6)]
PROBABLY = 1.64
"""Standard deviations below which 95 % of a normal distribution lie."""


def demo(**tables: dict[str, Any]) -> Config:
    """The demo's configuration, with other values in some tables."""
    config = installation.load(ROOT / "config" / "demo.toml")
    changed = {name: getattr(config, name).model_copy(update=keys) for name, keys in tables.items()}
    return config.model_copy(update=changed)


@cache
def of_demo() -> dict[str, Any]:
    return detectable(demo(estimator={"period_s": 1.0}))


@pytest.fixture
def no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the sensors that are there: to try a further one at ten positions takes ten times as long."""
    monkeypatch.setattr(sensitivity, "_further", lambda *_: None)


def column(found: dict[str, Any], key: str) -> list[float]:
    return [row[key] for row in found["minimal_detectable"].values()]


def text_of(config: Any) -> str:
    console = Console(width=110, highlight=False)
    with console.capture() as printed:
        console.print(as_text(findings(config)))
    return printed.get()


def expected_sigma_K(bank: Bank) -> Any:
    """Return how uncertain each reading is by the filter without it, noise included."""
    rows = np.asarray(bank._filters_record.work.C)
    states = [bank._runnings[f] for f in bank.design.without_one]
    variance_K2 = [
        c[: len(s.x)] @ s.P[:, : len(s.x)] @ c[: len(s.x)] for c, s in zip(rows, states, strict=True)
    ]
    return np.sqrt(np.array(variance_K2) + np.asarray(bank._batch.plant.R_K2))


def test_the_least_faults_are_by_the_sigma_that_estimate_and_bank_have_over_the_shift(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To some per cent: steps of 2 s, where the filter has one a second and the bank one of 5 s."""
    sigma_K: list[Any] = []
    plain = Bank._act

    def watched(self: Bank, main: Running, *args: Any) -> None:
        if main.verdict[0].age_s >= 600.0:
            sigma_K.append(expected_sigma_K(self))
        plain(self, main, *args)

    monkeypatch.setattr(Bank, "_act", watched)
    machine, u = shift_log(demo(estimator={"period_s": 1.0}))
    estimator = machine.estimator()
    _, block = estimator.run(estimator.initial(), u)
    innovation_K = block.innovation_sigma_K[block.time_s >= 600.0].mean(axis=0)
    jump_K = (JUMP_SIGMA + PROBABLY) * innovation_K + DRIFT_K_S * 1.0
    np.testing.assert_allclose(column(of_demo(), "fault_K"), jump_K, rtol=0.03)
    slow_K = (MISFIT + PROBABLY) * np.mean(sigma_K, axis=0)
    np.testing.assert_allclose(column(of_demo(), "slow_K"), slow_K, rtol=0.03)


@pytest.mark.parametrize(("period_s", "time_s"), [(0.5, 2.5), (1.0, 3.0), (5.0, 15.0)])
@pytest.mark.usefixtures("no_further")
def test_a_jump_is_decided_after_three_samples_and_two_seconds(period_s: float, time_s: float) -> None:
    """The first of them comes up to a sample after the jump."""
    assert column(detectable(demo(estimator={"period_s": period_s})), "time_s") == [time_s] * 5


@pytest.mark.usefixtures("no_further")
def test_a_sensor_that_comes_seldom_is_decided_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(demo()), "sample_s", {"t3_degC": 1.7})
    assert column(detectable(demo()), "time_s") == [2.5, 2.5, 6.0, 2.5, 2.5]


@pytest.mark.usefixtures("no_further")
def test_noise_hides_jumps() -> None:
    config = demo()
    noisy = tuple(
        s.model_copy(update={"noise_K": 0.3 if s.name == "t2" else s.noise_K}) for s in config.sensor
    )
    found = column(detectable(config.model_copy(update={"sensor": noisy})), "fault_K")
    assert found[1] == pytest.approx((JUMP_SIGMA + PROBABLY) * 0.3, rel=0.05)
    assert max(found[:1] + found[2:]) < 0.6


@pytest.mark.usefixtures("no_further")
def test_the_smallest_step_is_noticed_of_sensors_without_noise() -> None:
    config = demo(tolerance={"lag_s": 0.0}, estimator={"field_noise_K_sqrt_s": 1e-4})
    quiet = tuple(s.model_copy(update={"noise_K": 0.005}) for s in config.sensor)
    found = column(detectable(config.model_copy(update={"sensor": quiet})), "fault_K")
    assert found == pytest.approx([0.15 + 0.01 + PROBABLY * 0.005] * 5, abs=0.02)


def test_a_further_thermocouple_does_what_it_is_said_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    config = demo(estimator={"period_s": 1.0})
    said = of_demo()["further_sensor"]
    slow_K = dict(zip(NAMES, column(of_demo(), "slow_K"), strict=True))
    assert slow_K[said["sensor"]] == said["slow_K_now"] == max(slow_K.values())
    new = config.sensor[0].model_copy(
        update={"name": "t6", "channel": "t6", "position_m": said["position_m"]}
    )
    monkeypatch.setattr(sensitivity, "_further", lambda *_: None)
    then = detectable(config.model_copy(update={"sensor": (*config.sensor, new)}))["minimal_detectable"]
    assert then[said["sensor"]]["slow_K"] == pytest.approx(said["slow_K_then"])
    assert said["slow_K_then"] < 0.5 * said["slow_K_now"]
    assert buys(said) == (
        f"a thermocouple at {said['position_m']:.3g} m would bring {said['sensor']}'s slow fault from "
        f"{said['slow_K_now']:.3g} to {said['slow_K_then']:.3g} K"
    )


def test_no_place_is_praised_that_helps_little() -> None:
    said = buys({"position_m": 0.5, "sensor": "t1", "slow_K_now": 2.0, "slow_K_then": 1.95})
    assert said.startswith("no further thermocouple")
    assert buys(None) == ""


def test_a_further_thermocouple_is_placed_away_from_others() -> None:
    config = demo()
    at_ends = {"t1": 0.01, "t5": 0.99}
    sensors = tuple(
        s.model_copy(update={"position_m": at_ends.get(s.name, s.position_m)}) for s in config.sensor
    )
    found = detectable(config.model_copy(update={"sensor": sensors}))["further_sensor"]
    assert all(abs(found["position_m"] - s.position_m) >= 0.02 for s in sensors)


def housings() -> Installation:
    """A machine as most are: thermocouples on nut bracket and bearing housings."""
    given = {
        "length_m": "1.1",
        "stroke_m": "150 850 mm",
        "housings": "all",
        "module_at": "h",
        "ambient": "21",
    }
    control = {"control": "modbus", "control_at": "h", "counts_per_m": "1e6", "speed_register": "2"}
    return parse(tomllib.loads(filled(answers(given | control, None))))


def test_on_a_machine_with_housings_no_thermocouple_on_the_turning_screw_is_advised() -> None:
    config = housings()
    found = detectable(config)["further_sensor"]
    assert found["position_m"] is None
    assert found["on"] in {node.name for node in config.node}
    assert f"more on {found['on']} would bring" in buys(found)
    assert found["slow_K_then"] < found["slow_K_now"]
    text = text_of(config)
    assert "node near" not in text
    assert "sensor on the screw" not in text
    assert "Nothing has to be done." in text
    assert "without nut_body or left_housing or right_housing some heats are only predicted" in text


def test_what_can_be_mounted_is_what_the_candidates_name() -> None:
    candidate = SensorCandidate(name="foot", on="left_housing")
    config = housings().model_copy(update={"candidate": (candidate,)})
    assert detectable(config)["further_sensor"]["on"] == "left_housing"


def test_a_model_without_tolerances_is_held_against_no_slow_fault() -> None:
    config = demo()
    known = dict.fromkeys(config.tolerance.model_dump(), 0.0)
    config = demo(tolerance=known)
    assert build_plant(config, learns=True).learnt == 0
    found = detectable(config)
    assert column(found, "slow_K") == [None] * 5
    assert found["further_sensor"] is None
    assert max(column(found, "fault_K")) < 0.6
    assert "–" in next(line for line in text_of(config).splitlines() if line.startswith("t1 "))


@pytest.mark.parametrize(
    ("tables", "reason"),
    [
        ({"integrity": {"enabled": False}}, "[integrity] enabled = false"),
        ({"estimator": {"kind": "luenberger"}}, 'kind = "luenberger"'),
        ({"estimator": {"engine": "constant"}}, 'engine = "constant"'),
        ({"estimator": {"engine": "filterpy"}}, 'engine = "filterpy"'),
    ],
)
def test_where_nothing_is_screened_nothing_is_promised_and_the_reason_is_said(
    tables: dict[str, dict[str, Any]], reason: str
) -> None:
    found = detectable(demo(**tables))
    assert (found["minimal_detectable"], found["further_sensor"]) == ({}, None)
    assert "nothing is screened" in found["not_screened"]
    assert reason in found["not_screened"]


def test_the_text_has_the_table_and_the_sentence_or_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as known:
        known.setattr(check, "detectable", lambda _: of_demo())
        said = text_of(demo())
    assert "sensor  jump noticed, K  within, s  slow fault noticed, K\nt1 " in said
    assert "would bring t1's slow fault from" in said
    assert "faults in values" not in said
    assert "passes for heat" not in said
    without = text_of(demo(integrity={"enabled": False}))
    assert "jump noticed" not in without
    assert "nothing is screened: [integrity] enabled = false" in without


@pytest.mark.usefixtures("no_further")
def test_on_housings_it_is_said_that_sigma_holds_no_slow_fault() -> None:
    housed = installation.load(ROOT / "config" / "demo-housings.toml")
    found = detectable(housed)
    assert (found["slow_in_sigma"], detectable(demo())["slow_in_sigma"]) == (False, True)
    assert min(column(found, "slow_K")) > 20.0
    (_, said) = _least(found["minimal_detectable"], None, found["slow_in_sigma"])
    assert "no bound is published" in str(said)


def test_too_many_states_are_said_not_to_be_worked_out() -> None:
    config = demo()
    many = [s.model_copy(update={"name": f"s{i}{s.name}"}) for i in range(25) for s in config.sensor]
    found = detectable(config.model_copy(update={"sensor": tuple(many)}))
    assert found["minimal_detectable"] == {}
    assert "too many states" in found["not_screened"]
