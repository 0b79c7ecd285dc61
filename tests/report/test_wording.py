"""The sentences of a search: which figures, effects and doubts they have for each verdict."""

from __future__ import annotations

from copy import deepcopy
from types import SimpleNamespace
from typing import Any

import pytest

from observer.config.effects.catalogue import LIBRARY
from observer.config.sensors import Sensor
from observer.discovery.verdict import Verdict
from observer.report.discovery import _suspects, site
from observer.report.wording import as_sentences, interval, joined
from tests.report.verdicts import BASE, BODY, FELL, SURFACE, TEST, candidate


def sentences(verdict: str, changes: dict[str, Any], *blind: Any, **more: Any) -> list[str]:
    """The sentences of a verdict; `more` is what it says beside its kind."""
    decided = Verdict(verdict, None, **more)  # type: ignore[arg-type]
    found: Any = SimpleNamespace(verdict=decided, search=SimpleNamespace(blind=blind))
    return list(as_sentences(found, deepcopy(BASE) | {"verdict": verdict} | changes))


def effect(kind: str, key: str, value: float, low: float, high: float, unit: str) -> dict[str, Any]:
    return {
        "kind": kind,
        "target": "left",
        "parameters": {key: {"value": value, "ci95": [low, high], "unit": unit}},
    }


NAMED = [
    effect("sensor_lag", "time_constant_s", 41.23, 38.1, 44.4, "s"),
    effect("end_conduction", "conductance_W_K", 0.0523, 0.0501, 0.0545, "W/K"),
]
TWO_ENDS = [candidate("end_heat", "left"), candidate("radiation"), candidate("end_heat", "right")]
EVENT = {
    "sensor": "t3", "phase": "steady", "regressor": "event", "rms_K": 3.1, "mean_K": 3.1, "log": 2,
    "from_s": 2400.0, "to_s": 3600.0, "heat_W": 24.2, "heat_sigma_W": 1.0,
}  # fmt: skip
COOLER = EVENT | {"heat_W": -24.2, "mean_K": -3.1}
MOTOR_OR_TWO = [[candidate("motor_heat", "right")], [candidate("radiation"), candidate("dwell", "nut")]]
TIED = [[candidate("surface_convection")], [candidate("radiation")]]
HEAT = {"heat_W": {"value": 4.0, "ci95": [3.5, 4.5], "unit": "W"}}
AT_END = {"name": "end_source", "target": "left", "members": ["motor_heat at left"], "effective": HEAT}
BESIDE = {"name": None, "target": None, "members": ["sensor_bias at t2"], "effective": {}}
FITTED = {"remains": "in what was fitted"}
LATE = {"what": "heat starts late", "channel": None, "by": 180.0, "text": "The heat starts 180 s later"}
RESTS = {"lacking": ("it never rests",)}
FELL_UNKNOWN = ("0.63 K to 0.16 K rms", "0.61 K to 0.042 K", "0.0070 K")


@pytest.mark.parametrize(
    ("made", "figures"),
    [
        (
            sentences("none", {}, *TWO_ENDS),
            [
                ("no missing effect",),
                ("0.050 K rms", "0.031 K beyond", "1.27 K", "0.0070 K"),
                ("the left end and the right end", ", nor heat radiated"),
            ],
        ),
        (
            sentences("named", {"effects": NAMED, "gap": FELL}),
            [
                ("lacks a lag of sensor left and heat that flows into the housing at the left end.",),
                ("sensor_lag at left: time_constant_s = 41.2 (38.1 … 44.4) s",),
                ("end_conduction at left: conductance_W_K = 0.0523 (0.0501 … 0.0545) W/K",),
                ("rms, beyond", *FELL_UNKNOWN),
            ],
        ),
        (
            sentences("ambiguous", {"gap": FELL, "experiment": TEST}, sets=MOTOR_OR_TWO),
            [
                ("the right end", "; or heat radiated by the surface and heat of nut"),
                ("2 h 00 min", "stand still", "21.3 standard deviations."),
                ("with the first of them", *FELL_UNKNOWN),
            ],
        ),
        (
            sentences("ambiguous", {"gap": FELL, "family": SURFACE}, sets=TIED),
            [("from the surface of 4.53 (4.12 … 4.94) W/m²K in effect; ", "; or "), FELL_UNKNOWN],
        ),
        (
            sentences("ambiguous", {"gap": FELL, "family": AT_END | {"beside": [BESIDE]}}, sets=TIED),
            [("the left end of 4.00 (3.50 … 4.50) W in effect and a constant error of sensor t2;",), ()],
        ),
        (
            sentences("unknown", {"gap": FELL, "partial": BODY | {"family": SURFACE}}, **FITTED),
            [
                ("remains in what was fitted.",),
                ("4.53 (4.12 … 4.94) W/m²K", "84 %; 1.41 K", "0.92 K beyond", "most on t1, while heating up"),
                ("with the best that the library offers", *FELL_UNKNOWN),
            ],
        ),
        (
            sentences("unknown", {"gap": FELL, "partial": BODY | {"phase": None}}, **FITTED),
            [(), ("attached_mass at left: capacity_J_K = 150 (140 … 160) J/K", "most on t1."), ()],
        ),
        (
            sentences("unknown", {"gap": FELL, "where": [EVENT]}, **FITTED),
            [(), ("t3 in log 2, from 40 min to 1 h 00 min", "24 ± 2 W more heat", "3.10 K above"), ()],
        ),
        (
            sentences("unknown", {"gap": FELL, "where": [COOLER]}, **FITTED),
            [(), ("24 ± 2 W less heat", "3.10 K below"), ()],
        ),
        (
            sentences("unknown", {"gap": FELL, "suspects": [LATE]}, suspected=(LATE["text"],)),
            [("in doubt, so no effect",), (f"{LATE['text']}.",), ()],
        ),
    ],
)  # fmt: skip
def test_each_verdict_has_its_lines_with_its_figures(made: list[str], figures: list[tuple[str, ...]]) -> None:
    for line, expected in zip(made, figures, strict=True):
        for part in expected:
            assert part in line


@pytest.mark.parametrize(
    ("sigma", "said"),
    [(0.01, "None of the usual test cycles"), (3.0, "not be enough"), (1e4, "more than 100")],
)
def test_a_test_is_not_praised_beyond_what_it_shows(sigma: float, said: str) -> None:
    lines = sentences("not_identifiable", {"experiment": TEST | {"separation_sigma": sigma}}, **RESTS)
    assert "not identifiable from these logs: it never rests." in lines[0]
    assert said in lines[1]


def test_the_site_of_a_sensor_is_its_position_or_its_node() -> None:
    assert site(Sensor(name="t1", channel="t1_degC", position_m=0.25, noise_K=0.05)) == "0.25 m"
    assert site(Sensor(name="t2", channel="t2_degC", on="housing", noise_K=0.05)) == "housing"


def test_every_effect_of_the_library_names_its_target_where_it_has_one() -> None:
    assert joined(["a", "b", "c"]) == "a, b and c"
    for kind in LIBRARY:
        assert ("{target}" in kind.missing_physics) == (kind.targets is not None)


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
def test_a_value_has_the_digits_that_its_interval_leaves(
    triple: tuple[float, float, float], text: str
) -> None:
    assert interval(*triple) == text


def test_the_page_lists_suspects_with_their_channels() -> None:
    page = _suspects({"suspects": [LATE, LATE | {"what": "units", "channel": "t1_degC"}]})
    assert "heat starts late" in page
    assert "<code>t1_degC</code>" in page
    assert not _suspects({"suspects": []})
