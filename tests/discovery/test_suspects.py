"""What is wrong with logs is reported, with the channel; and nothing of logs that are right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from campaigns.discovery.suspects import judged, suspect_summary, suspects_of, try_suspect
from observer.align.unit_errors import in_configured_units
from observer.discovery.candidates import library, promises, signatures
from observer.discovery.discover import _counts, discover
from observer.discovery.log_faults import FaultFit, fit_faults, late, offsets
from observer.discovery.suspects import Suspect, alike, plain, suspects
from observer.discovery.verdict import Verdict, under_suspicion
from observer.files.logs import Log
from observer.fit.hypothesis import fit_effects, fit_null
from observer.installation import parse
from tests.discovery.small import problem_of
from tests.discovery.written import CONFIG, left, trial
from tests.logs.machines import machine, table
from tests.logs.simulated import made_log
from tests.truth.machine.cycles import RUNS
from tests.truth.machine.entries import Entry, suspect_campaign, typical_campaign
from tests.truth.machine.generate import Case, Run, logged, machine_of, runs_of, trace
from tests.truth.machine.troubles import TROUBLES, Trouble, troubled


def entry_of(trouble: str | None, seed: int, logs: int = 1) -> Entry:
    return Entry("suspect", "one", Case("suspects", (), seed, logs=logs), trouble=trouble)


@pytest.mark.parametrize("trouble", ["sensors exchanged", "ambient", "offsets"])
def test_what_is_wrong_with_one_log_is_reported(trouble: str) -> None:
    entry = entry_of(trouble, 5)
    made = troubled(entry.case, trouble)
    (suspect,) = suspects_of(entry, made)
    assert suspect.what == trouble
    assert all(channel in str(suspect.channel) for channel in made.about)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("trouble", TROUBLES)
def test_what_is_wrong_with_logs_is_reported(trouble: str, tmp_path: Path) -> None:
    row = try_suspect(entry_of(trouble, 6, logs=2), tmp_path)
    assert row.outcome == "right", row


def test_nothing_is_reported_of_a_log_that_is_right() -> None:
    entry = entry_of(None, 5)
    assert suspects_of(entry, Trouble(runs_of(entry.case), ())) == ()


def run_with_torque(case: Case, name: str, factor: float) -> Run:
    """A log of the case's machine whose nut has so many times its friction."""
    own = machine_of(case)
    friction_W_rpm = own.physics.friction_W_rpm * np.array([factor, 1.0, 1.0])
    heavier = replace(own, physics=own.physics._replace(friction_W_rpm=friction_W_rpm))
    return logged(case, name, trace(case, name, heavier))


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("factors", "ratio"), [((1.05, 1.02, 0.92), 1.14), ((1.0, 1.03, 1.0), None)], ids=["differs", "tolerated"]
)
def test_a_torque_that_differs_between_three_logs_is_reported_beyond_its_tolerance(
    factors: tuple[float, ...], ratio: float | None
) -> None:
    """A seventh between the first log and the last: 1 K that no effect explains, for a typical user."""
    case = Case("torque15", (), 24, typical=True)
    runs = [run_with_torque(case, *each) for each in zip(RUNS, factors, strict=True)]
    reported = suspects_of(Entry("suspect", "one", case), Trouble(runs, ()))
    assert [s.what for s in reported] == ([] if ratio is None else ["heat differs between logs"])
    for suspect in reported:
        assert "of nut in log 1 as in log 3" in suspect.text
        assert float(suspect.by) == pytest.approx(ratio, abs=0.02)


def test_an_effect_that_explains_as_much_is_no_fault_of_the_logs() -> None:
    """Air that is 2 K warmer than stated, and a candidate whose fit leaves just as little, or more."""
    truth = machine(ambient={"temperature_degC": 22.0})
    config = machine()
    null = fit_null(problem_of(config, [made_log(truth, 1)]), config)
    best = fit_faults(null)[0]
    assert best.fault.kind == "ambient"
    assert best.values == pytest.approx([2.0], abs=0.1)
    right = fit_effects(null.problem, truth, ())
    rival, useless = (trial("a", 0.0, fit) for fit in (replace(right, problem=null.problem), null))
    assert plain(null, best, [useless])
    assert not plain(null, best, [useless, rival])


@pytest.mark.slow
@pytest.mark.nightly
def test_air_far_off_what_is_tolerated_is_reported_though_tolerances_explain_the_logs() -> None:
    """Those of the air and of offsets take all of it; the air alone is dearer than it may be."""
    (entry,) = (e for e in suspect_campaign(9100) if e.name == "suspect.ambient.9104")
    (suspect,) = suspects_of(entry, troubled(entry.case, "ambient"))
    assert suspect.what == "ambient"


@pytest.mark.parametrize(("by", "expected"), [(1.0, False), (-1.0, True)])
def test_an_effect_that_was_not_fitted_but_explains_all_logs_is_no_fault_of_them(
    by: float, expected: bool
) -> None:
    """A suspect that leaves a little more than heat at an end promises to, and one that leaves less."""
    config = machine()
    truth = machine(effect=[{"kind": "motor_heat", "target": "left", "heat_W": 0.3}])
    null = fit_null(problem_of(config, [made_log(truth, 1)]), config)
    motor = [c for c in library(config, null.problem.keys) if c.name == "motor_heat at left"]
    found = signatures(null.problem, null.config, motor)
    fitted, everywhere = promises(null, found)[0].drop, promises(null, found, everywhere=True)[0].drop
    assert 100.0 < 2.0 * fitted < everywhere < null.deviance_of_all  # the proof shows more of it
    clocks = next(w for w in fit_faults(null) if w.fault.kind == "heat starts late")
    suspected = replace(clocks, left=null.deviance_of_all - everywhere + by, drop=everywhere - by)
    assert plain(null, suspected, [])
    assert plain(null, suspected, [], found) is expected


def test_of_logs_in_doubt_nothing_is_reported_missing() -> None:
    """Inputs that are recorded 200 s early: neither a partial answer nor an event of the machine."""
    config = machine()
    log = made_log(config, 1)
    early = [log.channels.index(name) for name in ("heater_W", "n_rpm")]
    values = log.values.copy()
    values[:, early] = np.vstack([values[100:, early], np.repeat(values[-1:, early], 100, axis=0)])
    found = discover(config, [[replace(log, values=values)]])
    assert [s.what for s in found.suspects] == ["heat starts late"]
    assert found.verdict.kind == "unknown"
    assert found.verdict.suspected
    assert found.partial is None
    assert found.event is None


@pytest.mark.parametrize(("offset_K", "reported"), [(0.3, []), (1.4, ["b_degC"])])
def test_an_offset_unlikely_within_its_tolerance_is_reported_though_not_named(
    offset_K: float, reported: list[str]
) -> None:
    config = machine(tolerance={"offset_K": 0.3})
    bias = machine(effect=[{"kind": "sensor_bias", "target": "b", "offset_K": offset_K}]).effect
    truth = config.model_copy(update={"effect": bias})
    found = discover(config, [[made_log(truth, seed, minutes=60.0)] for seed in range(2)])
    assert not found.verdict.sets
    assert [s.channel for s in found.suspects] == reported
    if reported:
        assert float(found.suspects[0].by) == pytest.approx(offset_K, abs=0.6)
        assert "compare it with the other sensors" in found.suspects[0].text


@pytest.mark.slow
@pytest.mark.nightly
def test_an_effect_beside_offsets_as_they_are_tolerated_is_no_fault_of_the_logs() -> None:
    """Offsets beyond all tolerance would explain heat at an end too: as a profile that stays."""
    (entry,) = (e for e in typical_campaign(6000) if e.name == "typical.motor_heat.left.4.6000")
    assert suspects_of(entry, Trouble(runs_of(entry.case), ())) == ()


def test_a_power_in_kilowatts_is_reported() -> None:
    config = machine(calibrate={"free": ["source.heater.scale"]})
    log = made_log(config, 1)
    heater = log.channels.index("heater_W")
    log.values[:, heater] /= 1000.0
    null = fit_null(problem_of(config, [log]), config)
    (suspect,) = suspects(null, ())
    assert (suspect.what, suspect.channel, suspect.by) == ("units", "heater_W", "kW")


NUT: dict[str, Any] = {
    "name": "nut", "shape": "nut", "length_m": 0.04, "stroke_m": [0.1, 0.3], "position_channel": "x_m",
    "speed_channel": "n_rpm", "lead_m": 0.01, "torque_Nm": 0.1, "share": 0.5,
}  # fmt: skip


@pytest.mark.parametrize(
    ("channel", "factor", "more", "unit"),
    [
        ("a_degC", 1.8, 32.0, "°F"),
        ("a_degC", 1.0, 273.15, "K"),
        ("air_degC", 1.8, 32.0, "°F"),
        ("air_degC", 1.0, 273.15, "K"),
        ("x_m", 1000.0, 0.0, "mm"),
        ("n_rpm", np.pi / 30.0, 0.0, "rad/s"),
        ("n_rpm", 1.0 / 60.0, 0.0, "revolutions a second"),
        ("a_degC", 1.0, 0.0, None),
    ],
)
def test_a_channel_in_another_unit_is_read_in_it(
    channel: str, factor: float, more: float, unit: str | None
) -> None:
    config = parse(table(source=[NUT], ambient={"channel": "air_degC"}))
    time_s = np.arange(0.0, 900.0, 0.5)
    turning = (time_s > 60.0) & (time_s < 840.0)
    way_m = np.cumsum(np.where(turning, 120.0, 0.0)) / 60.0 * 0.01 * 0.5
    columns = {
        "a_degC": 22.0 + 5.0 * time_s / 900.0, "b_degC": 22.0 + 4.0 * time_s / 900.0,
        "c_degC": 22.0 + 3.0 * time_s / 900.0, "x_m": 0.1 + np.abs((way_m + 0.2) % 0.4 - 0.2),
        "n_rpm": np.where(turning, 120.0, 0.0), "air_degC": 21.5 + 0.5 * np.sin(time_s / 300.0),
    }  # fmt: skip
    spoilt = columns | {channel: columns[channel] * factor + more}
    log = Log(Path("log"), time_s, tuple(spoilt), np.column_stack(list(spoilt.values())))
    read, found = in_configured_units(log, config)
    assert [(m.channel, m.unit) for m in found] == ([] if unit is None else [(channel, unit)])
    np.testing.assert_allclose(read.values, np.column_stack(list(columns.values())), atol=1e-9)


def test_a_fault_code_is_no_unit() -> None:
    config = machine()
    time_s = np.arange(0.0, 600.0, 2.0)
    names = ("a_degC", "b_degC", "c_degC", "heater_W", "n_rpm")
    values = np.tile([3276.7, 20.0, 20.0, 0.0, 0.0], (len(time_s), 1))
    assert in_configured_units(Log(Path("log"), time_s, names, values), config)[1] == ()


def test_a_machine_that_gets_hot_is_in_no_other_unit() -> None:
    """Without `[limits]` a reading 45 K above the air is refused; it is no tenth of a degree for that."""
    config = machine()
    time_s = np.arange(0.0, 6000.0, 2.0)
    hot_degC = 20.0 + 90.0 * (1.0 - np.exp(-time_s / 600.0))
    names = ("a_degC", "b_degC", "c_degC", "heater_W", "n_rpm")
    still = np.zeros_like(time_s)
    values = np.column_stack([hot_degC, hot_degC, hot_degC, still + 5.0, still])
    assert in_configured_units(Log(Path("log"), time_s, names, values), config)[1] == ()


@pytest.mark.parametrize(
    ("kind", "after"),
    [("named", "unknown"), ("ambiguous", "unknown"), ("unknown", "unknown"), ("none", "none"),
     ("not_identifiable", "not_identifiable")],
)  # fmt: skip
def test_nothing_is_named_while_the_logs_are_in_doubt(kind: Any, after: str) -> None:
    fit: Any = None
    verdict = under_suspicion(Verdict(kind, fit, remains="in what was fitted"), ["The clocks differ"])
    assert verdict.kind == after
    assert ("The clocks differ" in verdict.reason) == (after != "not_identifiable")
    assert "explains" not in verdict.reason
    assert under_suspicion(Verdict(kind, fit), []).kind == kind


def suspect(what: Any, channel: str | None = None) -> Suspect:
    return Suspect(what, channel, 1.0, "What is wrong")


def test_suspects_are_judged_by_what_and_where() -> None:
    exchanged, right = entry_of("sensors exchanged", 1), suspect("sensors exchanged", "t1_degC, t3_degC")
    about = ("t1_degC", "t3_degC")
    assert judged(exchanged, about, [right]) == "right"
    assert judged(exchanged, about, [right, suspect("units", "t1_degC")]) == "extra"
    assert judged(exchanged, about, [suspect("sensors exchanged", "t1_degC, t2_degC")]) == "wrong"
    assert judged(exchanged, about, []) == "missed"
    assert judged(entry_of(None, 1), (), []) == "none"
    assert judged(entry_of(None, 1), (), [right]) == "wrong"
    line = {"trouble": "units", "hidden": "", "reported": "units; ambient", "outcome": "extra"}
    quiet = {"trouble": "", "hidden": "ambient_drift", "reported": "ambient", "outcome": "same"}
    page = suspect_summary([line, quiet])
    assert "| units | 1/1 = 100.0 % | 2.5 … 100.0 % | yes | 0/1 = 0.0 % |" in page
    assert "| ambient | – | – | – | 1/1 = 100.0 % |" in page


@pytest.mark.parametrize(
    ("values_K", "same"), [((1.2, 1.0, 1.4), True), ((2.0, -0.4, 0.8), False), ((-1.1, -1.3, -0.9), True)]
)
def test_offsets_that_are_alike_are_the_airs(values_K: tuple[float, ...], same: bool) -> None:
    values = np.array(values_K)
    assert alike(FaultFit(offsets(CONFIG), 0.0, 0.0, values, CONFIG)) is same
    assert not alike(FaultFit(late(left(0.3).problem, 60.0), 0.0, 0.0, values, CONFIG))


DRIFT = {"kind": "ambient_drift", "rate_K_h": 1.5}
GLOW = {"kind": "radiation", "emissivity": 0.8}


@pytest.mark.parametrize(
    ("effects", "named", "counts"),
    [([DRIFT], True, False), ([DRIFT, GLOW], True, True), ([GLOW], True, True), ([DRIFT], False, True)],
)
def test_air_alone_stands_against_what_is_named_beside_it(
    effects: list[dict[str, Any]], *, named: bool, counts: bool
) -> None:
    """And an answer that is unknown reports what the air did in each log."""
    verdict = Verdict("named", left(0.3, *effects), sets=((),) if named else ())
    assert _counts(Suspect("ambient", None, 1.0, "The air differs"), verdict) == counts
