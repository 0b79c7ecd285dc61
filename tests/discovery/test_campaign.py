"""The campaign's judge and its summary, on results made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from campaigns.discovery import __main__ as command
from campaigns.discovery import trial
from campaigns.discovery.judge import estimates, hidden_names, is_good, outcome_of
from campaigns.discovery.showing import RESTING, RUNNING, Showing, showing_of
from campaigns.discovery.summary import (
    Share,
    detection_limit,
    limit_lines,
    parameter_lines,
    summary,
)
from campaigns.resumable import with_tables
from observer.config.effects.catalogue import KINDS
from observer.discovery import localise
from tests.truth.machine.effects import LIBRARY, Effect
from tests.truth.machine.entries import Entry, campaign
from tests.truth.machine.generate import Case

MOTOR = Effect("motor_heat", "left", {"heat_W": 2.0})
BIAS = Effect("sensor_bias", "t3", {"offset_K": -1.0})
SHOWS = Showing(0.4, ("t3",), RUNNING)
LABEL = "motor_heat.left"


def found(effect: Effect, **ci95: tuple[float, float, float]) -> dict[str, Any]:
    """An effect as a result names it; `ci95`: low, value, high of a parameter in place of the truth."""
    ranges = {
        key: (0.9 * v, v, 1.1 * v) if v > 0 else (1.1 * v, v, 0.9 * v) for key, v in effect.parameters.items()
    }
    parameters = {
        key: {"value": value, "ci95": [low, high], "unit": "1"}
        for key, (low, value, high) in (ranges | ci95).items()
    }
    return {"kind": effect.kind, "target": effect.target, "parameters": parameters}


def result(
    verdict: str, *effects: dict[str, Any], sets: Sequence[Sequence[Any]] = (), **more: Any
) -> dict[str, Any]:
    gap = {"before_rms_K": 0.4, "after_rms_K": 0.06, "floor_rms_K": 0.05}
    return {
        "verdict": verdict,
        "effects": list(effects),
        "alternatives": sets,
        "where": [],
        "gap": gap,
    } | more


def entry(group: str, *effects: Effect, **more: Any) -> Entry:
    return Entry(group, LABEL, Case(group, effects, 1000), **more)


ONE, TWO, NULL = entry("ladder", MOTOR), entry("pair", MOTOR, BIAS), entry("null")


@pytest.mark.parametrize(
    ("hidden", "answer", "outcome"),
    [
        (ONE, result("named", found(MOTOR)), "right"),
        (ONE, result("named", found(BIAS)), "wrong"),
        (ONE, result("named", found(replace(MOTOR, target="right"))), "wrong"),
        (ONE, result("named", found(MOTOR), found(BIAS)), "extra"),
        (ONE, result("unknown", found(MOTOR)), "partly"),
        (ONE, result("unknown", found(BIAS)), "wrong"),
        (ONE, result("unknown"), "unknown"),
        (ONE, result("none"), "none"),
        (ONE, result("not_identifiable"), "not_identifiable"),
        (ONE, result("ambiguous", sets=[["local_heat"], ["motor_heat"]]), "in_set"),
        (ONE, result("ambiguous", sets=[["local_heat"], ["motor_heat at left"]]), "in_set"),
        (ONE, result("ambiguous", sets=[[{"kind": "motor_heat", "target": "left"}], ["end_heat"]]), "in_set"),
        (ONE, result("ambiguous", sets=[["local_heat"], ["motor_heat at right"]]), "wrong_set"),
        (ONE, result("ambiguous", sets=[["local_heat"], ["motor_heat", "sensor_bias"]]), "wrong_set"),
        (TWO, result("named", found(BIAS), found(MOTOR)), "right"),
        (TWO, result("named", found(MOTOR)), "partly"),
        (TWO, result("ambiguous", sets=[["sensor_bias", "motor_heat"], ["dwell", "end_heat"]]), "in_set"),
        (NULL, result("named", found(MOTOR)), "wrong"),
        (NULL, result("ambiguous", sets=[["motor_heat"], ["local_heat"]]), "wrong_set"),
        (entry("absent", MOTOR, without=("motor_heat",)), result("named", found(MOTOR)), "wrong"),
        (entry("outside", Effect("film_hour", None, {"factor": 2.0})), result("named", found(BIAS)), "wrong"),
    ],
)  # fmt: skip
def test_an_answer_is_judged_by_what_was_hidden(hidden: Entry, answer: dict[str, Any], outcome: str) -> None:
    assert outcome_of(hidden, answer) == outcome


def test_what_is_good_depends_on_what_could_be_known() -> None:
    assert is_good(NULL, "none")
    assert not is_good(NULL, "unknown")
    assert is_good(entry("absent", MOTOR, without=("motor_heat",)), "unknown")
    assert not is_good(ONE, "unknown")
    assert is_good(entry("housings", MOTOR), "unknown")
    assert not is_good(entry("housings", MOTOR), "none")
    assert not is_good(entry("housings"), "unknown")
    doubts = {e.label: e for e in campaign() if e.doubt}
    assert is_good(doubts["exponent"], "none")
    assert not is_good(doubts["exponent"], "wrong")
    assert not is_good(doubts["motor_or_bearing"], "right")  # one name where two fit is luck
    assert is_good(doubts["motor_or_bearing"], "in_set")


def test_parameters_are_compared_with_the_truth() -> None:
    spot = Effect("local_heat", None, {"position_m": 0.4, "heat_W": 3.0})
    answer = result("named", found(spot, position_m=(0.38, 0.39, 0.395), heat_W=(2.5, 2.7, 3.1)))
    place, heat = estimates(entry("ladder", spot), answer)
    assert (place.error, place.covered) == (pytest.approx(-0.01), False)  # of the screw's length
    assert (heat.error, heat.covered) == (pytest.approx(-0.1), True)
    assert estimates(ONE, answer) == []


def test_machine_and_library_speak_of_the_same_effects() -> None:

    assert set(LIBRARY) == set(KINDS)
    assert set(RUNNING) | set(RESTING) == set(localise.PHASES)
    assert all(hidden_names(e) for e in campaign() if e.group in ("ladder", "pair", "poor", "ambiguous"))
    assert not any(hidden_names(e) for e in campaign() if e.group in ("null", "outside", "absent"))


def rows() -> list[dict[str, str]]:
    """Eight seeds of five strengths, of which the weakest is missed, and ten nulls with one mistake."""
    strengths = (0.2, 0.5, 1.0, 2.0, 5.0)
    lines = []
    for rung, strength in enumerate(strengths):
        for seed in range(1000, 1008):
            motor = replace(MOTOR, parameters={"heat_W": strength})
            case = Entry("ladder", LABEL, Case("m", (motor,), seed), rung, strength)
            low = result("none") if rung == 0 else result("named", found(motor))
            lines.append(trial.judged(case, low, replace(SHOWS, rms_K=0.35 * strength), 8.0))
    for seed in range(1000, 1010):
        null = Entry("null", "null", Case("null", (), seed))
        answer = result("named", found(MOTOR)) if seed == 1003 else result("none", gap={"before_rms_K": 0.06})
        lines.append(trial.judged(null, answer, replace(SHOWS, rms_K=0.0), 8.0))
    return [asdict(line) for line in lines]


def test_the_summary_of_a_campaign_counts_rows() -> None:
    page = summary(rows())
    assert "| null: wrongly named | 1/10 = 10.0 % | 0.3 … 44.5 % | ≤ 1 % | **no** |" in page
    assert "| named rightly, ≥ 4 σ | 24/24 = 100.0 % | 85.8 … 100.0 % | ≥ 98 % | yes |" in page
    assert "| named rightly, 2–4 σ | 8/8 = 100.0 % |" in page
    assert "| two at once: both named | – | – | ≥ 90 % | – |" in page
    assert f"- `{LABEL}`, heat_W: 0.5" in limit_lines(rows())
    assert (
        parameter_lines(rows())[0]
        == "| parameter error, ≥ 4 σ: median / p90 | 0.0 % / 0.0 % | ≤ 3 % / 10 % | yes |"
    )


def test_a_limit_holds_for_everything_stronger() -> None:
    assert detection_limit((1.0, 2.0, 3.0), [Share(10, 10), Share(8, 10), Share(9, 10)]) == 3.0
    assert detection_limit((1.0, 2.0, 3.0), [Share(10, 10), Share(9, 10), Share(0, 0)]) is None


def test_where_a_hidden_thing_shows() -> None:
    """A sensor that lifts off shows at itself; the refit of the others spreads little."""
    loose = showing_of(Case("loose", (Effect("loose_sensor", "t2", {"contact": 0.6}),), 1000))
    assert loose.sensors == ("t2",)
    assert loose.sigma == pytest.approx(loose.rms_K / 0.05)
    assert loose.rms_K > 0.5
    nothing = showing_of(Case("loose", (), 1000))
    assert nothing.rms_K == 0.0


def test_unknowns_are_judged_by_place_and_phase() -> None:
    outside = entry("outside", Effect("stick_slip", None, {"factor": 2.0}))
    where = {"sensor": "t3", "phase": "steady", "regressor": "speed", "rms_K": 0.3}
    there = trial.judged(outside, result("unknown", where=[where]), SHOWS, 8.0)
    elsewhere = trial.judged(outside, result("unknown", where=[where | {"phase": "dwell"}]), SHOWS, 8.0)
    assert (there.localised, elsewhere.localised) == ("1", "0")
    assert trial.judged(outside, result("none"), SHOWS, 8.0).localised == ""


@pytest.mark.parametrize("name", ["rough", "housings"])
def test_the_page_describes_a_campaign_as_its_table_does(name: str) -> None:
    root, own = Path(__file__).parents[2], command.SLICES[name]
    page = (root / "docs/discovery.md").read_text(encoding="utf-8")
    rows = command.latest(root / "docs/campaign" / own.table)
    assert with_tables(page, own.summary(rows), own.marks) == page
    assert len(rows) == len(own.entries())
