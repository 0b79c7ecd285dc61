"""The sentences of a search: what they say of each verdict, in which words and digits."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer.discovery.verdict import Verdict
from observer.effects.catalogue import LIBRARY
from observer.report.discovery import _suspects, site
from observer.report.wording import as_sentences, interval
from observer.tables.sensors import Sensor
from tests.report.verdicts import BASE, BODY, FELL, SURFACE, TEST, candidate


def _lines(blind: Sequence[Any] = (), verdict: str = "none", said: Any = None, **changes: Any) -> list[str]:
    """The sentences of a verdict, with what it says beside its kind."""
    decided = Verdict(verdict, None, **(said or {}))  # type: ignore[arg-type]
    found: Any = SimpleNamespace(verdict=decided, search=SimpleNamespace(blind=blind))
    return list(as_sentences(found, deepcopy(BASE) | {"verdict": verdict} | changes))


def test_the_sentences_of_none() -> None:
    lines = _lines([candidate("end_heat", "left"), candidate("radiation"), candidate("end_heat", "right")])
    assert lines[0] == "The calibrated model explains the logs; no missing effect is visible."
    assert (
        "off by 0.050 K rms, 0.031 K beyond tolerances (as configured: 1.27 K; noise alone: 0.0070 K)"
        in lines[1]
    )
    assert lines[2:] == [
        "These logs cannot identify heat at the left end and the right end that grows with speed, nor heat "
        "radiated by the surface: the calibrated parameters could absorb it."
    ]


def test_a_sensor_is_on_the_screw_or_on_a_node() -> None:
    on_screw = Sensor(name="t1", channel="t1_degC", position_m=0.25, noise_K=0.05)
    assert site(on_screw) == "0.25 m"
    assert site(Sensor(name="t2", channel="t2_degC", on="housing", noise_K=0.05)) == "housing"


def test_the_sentences_of_effects_named() -> None:
    lag = {"time_constant_s": {"value": 41.23, "ci95": [38.1, 44.4], "unit": "s"}}
    loss = {"conductance_W_K": {"value": 0.0523, "ci95": [0.0501, 0.0545], "unit": "W/K"}}
    lines = _lines(
        verdict="named",
        effects=[
            {"kind": "sensor_lag", "target": "left", "parameters": lag},
            {"kind": "end_conduction", "target": "left", "parameters": loss},
        ],
        gap=FELL,
    )
    assert lines == [
        "The model lacks a lag of sensor left and heat that flows into the housing at the left end.",
        "  sensor_lag at left: time_constant_s = 41.2 (38.1 … 44.4) s",
        "  end_conduction at left: conductance_W_K = 0.0523 (0.0501 … 0.0545) W/K",
        "On data held back the gap goes from 0.63 K to 0.16 K rms, beyond tolerances from 0.61 K to 0.042 K "
        "(noise alone: 0.0070 K).",
    ]


def test_the_sentences_of_a_doubt_propose_the_test_that_would_decide() -> None:
    lines = _lines(
        verdict="ambiguous",
        said={
            "sets": [
                [candidate("motor_heat", "right")],
                [candidate("radiation"), candidate("dwell", "nut")],
            ]
        },
        gap=FELL,
        experiment=TEST,
    )
    assert "heat from the drive at the right end, the same at any speed; or heat radiated" in lines[0]
    assert lines[0].endswith("heat radiated by the surface and heat of nut that enters where it turns round.")
    assert lines[1].startswith(
        "A test of 2 h 00 min would decide: stand still; it separates the answers by 21.3"
    )
    assert "0.63 K to 0.16 K rms with the first of them" in lines[2]


def test_the_sentences_of_a_family_give_its_figure() -> None:
    said = {"sets": [[candidate("surface_convection")], [candidate("radiation")]]}
    lines = _lines(verdict="ambiguous", said=said, family=SURFACE, gap=FELL)
    assert lines[0] == (
        "The model lacks a loss of heat from the surface of 4.53 (4.12 … 4.94) W/m²K in effect; the logs "
        "cannot distinguish its possible causes: a loss of heat to the air over the whole surface; or heat "
        "radiated by the surface."
    )


def test_a_family_is_described_with_its_end_and_its_other_effects() -> None:
    heat = {"heat_W": {"value": 4.0, "ci95": [3.5, 4.5], "unit": "W"}}
    at_end = {"name": "end_source", "target": "left", "members": ["motor_heat at left", "end_heat at left"]}
    beside = {"name": None, "target": None, "members": ["sensor_bias at t2"], "effective": {}}
    family = at_end | {"effective": heat, "beside": [beside]}
    said = {"sets": [[candidate("motor_heat", "left")], [candidate("end_heat", "left")]]}
    (first, *_) = _lines(verdict="ambiguous", said=said, family=family, gap=FELL)
    assert first.startswith(
        "The model lacks heat at the left end of 4.00 (3.50 … 4.50) W in effect and a constant error of "
        "sensor t2; the logs cannot distinguish its possible causes: heat from the drive"
    )


def test_the_sentences_of_an_unknown_name_what_explains_most_and_what_remains() -> None:
    said = {"remains": "in what was fitted"}
    family = _lines(verdict="unknown", said=said, gap=FELL, partial=BODY | {"family": SURFACE})
    assert family[1] == (
        "Of what is missing a loss of heat from the surface of 4.53 (4.12 … 4.94) W/m²K in effect explains "
        "84 %; 1.41 K rms remain (0.92 K beyond tolerances), most on t1, while heating up."
    )
    alone = _lines(verdict="unknown", said=said, gap=FELL, partial=BODY | {"phase": None})
    assert alone[1] == (
        "Of what is missing a body that stores heat at the left end (attached_mass at left: capacity_J_K = "
        "150 (140 … 160) J/K) explains 84 %; 1.41 K rms remain (0.92 K beyond tolerances), most on t1."
    )


@pytest.mark.parametrize(
    ("sigma", "said"),
    [(0.01, "None of the usual test cycles"), (3.0, "not be enough"), (1e4, "more than 100")],
)
def test_a_test_is_not_praised_beyond_what_it_shows(sigma: float, said: str) -> None:
    lines = _lines(
        verdict="not_identifiable",
        said={"lacking": ("the machine never rests",)},
        experiment=TEST | {"separation_sigma": sigma},
    )
    assert lines[0] == (
        "Whether an effect is missing is not identifiable from these logs: the machine never rests."
    )
    assert said in lines[1]


@pytest.mark.parametrize(("heat_W", "said"), [(24.2, "more heat"), (-24.2, "less heat")])
def test_the_sentences_of_something_unknown_say_where_when_and_how_many_watts(
    heat_W: float, said: str
) -> None:
    event = {
        "sensor": "t3", "phase": "steady", "regressor": "event", "rms_K": 3.1,
        "mean_K": np.sign(heat_W) * 3.1, "log": 2, "from_s": 2400.0, "to_s": 3600.0,
        "heat_W": heat_W, "heat_sigma_W": 1.0,
    }  # fmt: skip
    lines = _lines(verdict="unknown", said={"remains": "in what was fitted"}, where=[event], gap=FELL)
    assert lines[0] == (
        "Something is missing that the library does not contain: an error remains in what was fitted."
    )
    assert lines[1].startswith(
        "The error is largest near sensor t3 in log 2, from 40 min to 1 h 00 min (warm and"
    )
    assert f"24 ± 2 W {said} than the model has" in lines[1]
    assert "with the best that the library offers" in lines[2]


def test_every_effect_of_the_library_can_be_said() -> None:
    for effect in LIBRARY:
        assert ("{target}" in effect.missing_physics) == (effect.targets is not None)


@pytest.mark.parametrize(
    ("triple", "text"),
    [
        ((0.067957, 0.066587, 0.069328), "0.0680 (0.0666 … 0.0693)"),
        ((3473.7, 2966.3, 3981.1), "3474 (2966 … 3981)"),
        ((-0.76, -0.86, -0.59), "−0.76 (−0.86 … −0.59)"),
        ((-1e-9, -0.004, 0.132), "0.000 (−0.004 … 0.132)"),
        ((0.5, 0.5, 0.5), "0.5"),
    ],
)
def test_values_are_said_to_the_digits_that_their_interval_leaves(
    triple: tuple[float, float, float], text: str
) -> None:
    assert interval(*triple) == text


def test_the_sentences_of_logs_in_doubt() -> None:
    late = {"what": "heat starts late", "channel": None, "by": 180.0, "text": "The heat starts 180 s later"}
    lines = _lines(verdict="unknown", said={"suspected": (late["text"],)}, suspects=[late], gap=FELL)
    assert lines[0] == "The logs themselves are in doubt, so no effect is reported as missing."
    assert lines[1] == "The heat starts 180 s later."
    page = _suspects({"suspects": [late, late | {"what": "units", "channel": "t1_degC"}]})
    assert "heat starts late" in page
    assert "<code>t1_degC</code>" in page
    assert not _suspects({"suspects": []})
