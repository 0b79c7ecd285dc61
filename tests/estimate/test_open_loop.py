"""An open loop starts from the temperature that it is given: as the first row says, and what comes of it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import observer
from observer import installation
from tests.truth.bar import Bar
from tests.truth.closed_forms import half_space_step

CONFIG = Path(__file__).parents[2] / "config"
SHIPPED = sorted(CONFIG.glob("*.toml"))
PRESCRIBED = {
    "left": {"kind": "prescribed", "channel": "left_degC"},
    "right": {"kind": "prescribed", "channel": "right_degC"},
}
LOSING = {end: {"kind": "convective", "coefficient_W_m2K": 200.0} for end in ("left", "right")}


def made(path: Path, **tables: object) -> observer.Machine:
    """The machine of a shipped configuration, some of its tables exchanged."""
    return observer.Machine(installation.parse(tomllib.loads(path.read_text(encoding="utf-8")) | tables), b"")


def program(machine: observer.Machine, seconds: int = 40, **channels: float) -> dict[str, np.ndarray]:
    """A log in which the machine runs at once, with every heat on and ends and air 10 K off 20 °C."""
    config, time_s = machine.config, np.arange(0.0, seconds, 0.5)
    sensors = {s.channel for s in config.sensor}
    values = {c: np.full(len(time_s), 900.0 if c.endswith("_rpm") else 30.0) for c in config.channels}
    values |= {c: 0.3 + 0.1 * np.sin(time_s) for c in config.channels if c.endswith("_m")}
    values |= {c: np.full(len(time_s), v) for c, v in channels.items()}
    return {"time_s": time_s} | {c: column for c, column in values.items() if c not in sensors}


def temperatures(run: observer.SimulatedRun, machine: observer.Machine) -> np.ndarray:
    """Every temperature that a run shows, (K, s + g)."""
    names = [s.channel for s in machine.config.sensor]
    names += [n for n in run.signals if n.startswith("field_")]
    return np.column_stack([run[n] for n in names])


KIM = {"criterion": "kim"}
CASES = [(path, {}) for path in SHIPPED]
CASES += [(CONFIG / f"{n}.toml", {"boundary": PRESCRIBED, "model": KIM}) for n in ("demo", "kim-screw")]
CASES += [(CONFIG / f"{n}.toml", {"boundary": LOSING, "model": KIM}) for n in ("demo", "li-network")]


@pytest.mark.parametrize(("path", "tables"), CASES)
def test_the_first_row_is_the_temperature_that_is_given(path, tables):
    machine = made(path, **tables)
    shown = temperatures(machine.simulate(program(machine), start_degC=20.0), machine)
    np.testing.assert_allclose(shown[0], 20.0, atol=1e-9)  # rounding of a few numbers of 20
    assert np.abs(shown[-1] - 20.0).max() > 0.01


def test_an_end_at_another_temperature_is_felt_as_heat_reaches():
    """Ends stepped by 10 and 5 K on a screw of Kim's few modes, against a half-space."""
    machine = made(CONFIG / "kim-rod.toml")
    run = machine.simulate(
        program(machine, 200, left_degC=30.0, right_degC=25.0, heater_W=0.0), start_degC=20.0
    )
    screw = machine.config.screw
    bar = Bar(
        conductivity_W_mK=screw.conductivity_W_mK,
        density_kg_m3=screw.density_kg_m3,
        specific_heat_J_kgK=screw.specific_heat_J_kgK,
    )
    x = np.linspace(0.0, screw.length_m, 21)
    field = np.column_stack([run[n] for n in run.signals if n.startswith("field_")])
    for k in (1, 20, 100, 399):
        time_s = run["time_s"][k]
        left, right = half_space_step(bar, 10.0, x, time_s), half_space_step(bar, 5.0, x[::-1], time_s)
        # after 200 s heat has gone 6 cm, so neither end feels the other
        np.testing.assert_allclose(field[k], 20.0 + left + right, atol=2e-3)


def warmed(sign: float, rpm: float = 600.0) -> list[str]:
    """What a replay doubts of a warm-up that a probe sees with this sign."""
    table = tomllib.loads((CONFIG / "kuznetsov-screw.toml").read_text(encoding="utf-8"))
    table["sensor"].append(
        {"name": "probe", "kind": "displacement", "channel": "probe_um", "position_m": 0.9, "noise_um": 0.5}
    )
    warming = observer.Machine(installation.parse(table), b"")
    time_s = np.arange(0.0, 3600.0, 5.0)
    run = warming.simulate({"time_s": time_s, "screw_speed_rpm": np.where(time_s > 300.0, rpm, 0.0)})
    noise_um = 0.5 * np.random.default_rng(3).standard_normal(len(time_s))
    log = {name: run[name] for name in ("t1_degC", "t2_degC", "screw_speed_rpm")}
    log |= {"time_s": time_s, "probe_um": sign * run["probe_um"] + noise_um}
    return list(warming.replay(log).summary["doubts"])


def test_a_probe_with_the_wrong_sign_is_named_and_no_other():
    (said,) = [doubt for doubt in warmed(-1.0) if "probe" in doubt]
    assert said.startswith("probe moves against what the heat laws make of the screw (correlation -1.00)")
    assert "negate its values" in said
    assert not warmed(1.0)


def test_a_sign_is_not_judged_where_nothing_warms():
    assert not warmed(-1.0, rpm=0.0)
