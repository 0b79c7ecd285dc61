"""`observer check`: its verdict, its picture, and that no number in it is none, whatever is configured."""

from __future__ import annotations

import json
import tomllib
import warnings
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from observer.installation import parse
from observer.report import sensitivity
from observer.report.check import findings, slow_polls
from observer.report.check_text import as_text

CONFIG = Path(__file__).parents[2] / "config"
INSULATED = {"left": {"kind": "insulated"}, "right": {"kind": "insulated"}}

CHANGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "as it is": lambda table: None,
    "one sensor": lambda table: table.update(sensor=table["sensor"][:1]),
    "no loss": lambda table: table.update(surface={"convection_W_m2K": 0.0}, boundary=INSULATED),
    "no expansion": lambda table: table["screw"].pop("expansion_1_K"),
    "rule (27)": lambda table: table["estimator"].update(pole_rule="kim"),
    "rule (27), fast": lambda table: table["estimator"].update(pole_rule="kim", period_s=0.1),
}
CASES = [(name, change) for name in ("kim-screw", "demo") for change in list(CHANGES)[:4]]
CASES += [("kim-rod", change) for change in ("as it is", "rule (27)", "rule (27), fast")]
CASES += [("li-lathe-axis", "no loss"), ("li-network", "one sensor"), ("yu-dual-drive", "as it is")]


@pytest.fixture
def no_further(monkeypatch: pytest.MonkeyPatch) -> None:
    """No further thermocouple is tried, which takes most of the time."""
    monkeypatch.setattr(sensitivity, "_further", lambda *_: None)


@pytest.mark.parametrize(("name", "change"), CASES)
def test_whatever_the_configuration_all_numbers_are_finite_and_no_library_warns(
    name: str, change: str, request: pytest.FixtureRequest
) -> None:
    if change != "as it is":
        request.getfixturevalue("no_further")
    table = tomllib.loads((CONFIG / f"{name}.toml").read_text(encoding="utf-8"))
    table.pop("drivers", None)
    CHANGES[change](table)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = findings(parse(table))
    json.dumps(found, allow_nan=False)
    console = Console(file=StringIO(), record=True, width=80)
    console.print(as_text(found))
    lines = console.export_text().splitlines()
    assert not [line for line in lines if {"nan", "inf", "-0", "None"} & set(line.split())]
    assert "…]" not in "".join(lines)
    usable = found["verdict"]["usable"]
    assert lines[0].startswith("usable; " if usable else "not usable: ")
    asked, reached = found["poles_requested_1_s"], found["poles_reached_1_s"]
    placed = bool(reached) and (not asked or np.allclose(np.sort(reached), np.sort(asked), rtol=0.05))
    assert usable == placed


@pytest.mark.usefixtures("no_further")
def test_a_single_warning_is_said_once() -> None:
    table = tomllib.loads((CONFIG / "kim-screw.toml").read_text(encoding="utf-8"))
    table["sensor"] = [
        *table["sensor"],
        *[dict(table["sensor"][0], name="t9", channel="t9_degC", position_m=0.45)],
    ]
    found = findings(parse(table))
    (only,) = found["warnings"]
    assert found["verdict"]["text"] == f"usable; 1 warning: {only}"
    console = Console(file=StringIO(), record=True, width=400)
    console.print(as_text(found))
    assert console.export_text().count(only) == 1


@pytest.mark.parametrize(
    ("film_W_m2K", "bore_m", "number"),
    [(10.0, 0.0, 0.1 / 60.5), (1000.0, 0.0, 10.0 / 60.5), (1000.0, 0.02, 7.5 / 60.5)],
)
@pytest.mark.usefixtures("no_further")
def test_a_screw_that_is_not_of_one_temperature_across_is_doubted(film_W_m2K, bore_m, number) -> None:
    """h (V/S)/k of Kim's screw, of 40 mm: V/S is a quarter of that, and less with a bore."""
    table = tomllib.loads((CONFIG / "kim-screw.toml").read_text(encoding="utf-8"))
    table["surface"]["convection_W_m2K"], table["screw"]["bore_m"] = film_W_m2K, bore_m
    found = findings(parse(table))
    assert found["biot"] == {"film_W_m2K": film_W_m2K, "number": pytest.approx(number)}
    assert any("Biot" in warning for warning in found["warnings"]) == (number > 0.1)


@pytest.mark.parametrize(
    ("period_s", "high_rpm", "hidden"),
    [
        (0.02, None, None),
        (0.05, None, None),
        (0.1, None, "62 mm"),
        (0.5, None, "581 mm"),
        (0.1, 1000.0, None),
    ],
)
def test_a_nut_that_is_polled_too_slowly_is_named_with_the_period_to_set(period_s, high_rpm, hidden):
    """No jump beyond the way at the greatest speed is hidden: 17 mm in 0.1 s at 1000 rpm, 579 mm in 0.5 s."""
    table = tomllib.loads((CONFIG / "demo-housings.toml").read_text("utf-8"))
    nut = next(source for source in table["source"] if "position_channel" in source)
    nut["lead_m"] = 0.01
    control = {"kind": "modbus_tcp", "host": "127.0.0.1", "period_s": period_s}
    names = (nut["position_channel"], nut["speed_channel"])
    channels = {name: {"register": 2 * i, "type": "int32"} for i, name in enumerate(names)}
    table["drivers"] = {"axis": control | {"channels": channels}}
    if high_rpm is not None:
        table["limits"] = {nut["speed_channel"]: {"low": -high_rpm, "high": high_rpm}}
    warnings_of_it = list(slow_polls(parse(table)))
    assert len(warnings_of_it) == (0 if hidden is None else 1)
    if hidden is not None:
        assert hidden in warnings_of_it[0]
        assert warnings_of_it[0].endswith("set period_s of its driver to 0.02")


STILL_AIR = {"kind": "natural_convection", "coefficient_W_m2K": 6.0}


@pytest.mark.usefixtures("no_further")
@pytest.mark.parametrize(("effects", "is_warned"), [([], True), ([STILL_AIR], False)])
def test_a_screw_that_loses_no_heat_is_warned_of_unless_still_air_takes_it(
    effects: list[dict[str, Any]], is_warned: bool
) -> None:
    table = tomllib.loads((CONFIG / "kim-screw.toml").read_text(encoding="utf-8"))
    CHANGES["no loss"](table)
    warnings_of_it = findings(parse(table | {"effect": effects}))["warnings"]
    assert any("can only rise" in warning for warning in warnings_of_it) == is_warned
