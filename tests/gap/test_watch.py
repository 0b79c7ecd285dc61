"""The gap watch: what it reports on machines of the independent truth, and what it keeps."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import observer
from campaigns.gap.months import EFFECTS, Rig
from observer.align.aligner import frames_of_log
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack, shifted, unpack
from observer.estimate.pipeline import MachineModel, Pipeline
from observer.files.folders import write_whole
from observer.frames import EstimateBlock, FrameBlock
from observer.installation import load
from observer.model.cycle import PHASES
from observer.quality.conditions import of_departure
from observer.quality.gap import BREAK_S, Departure, GapWatch
from observer.service.observers import stored
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Rough, config_of, day, draw, work
from tests.truth.machine.cycles import START_m, programme
from tests.truth.machine.logs import write_log
from tests.truth.machine.machine import stream

SEED = 8100
RIG = Path(__file__).parents[1] / "data" / "rig"


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig()


@pytest.fixture(scope="module")
def days(rig: Rig):
    """Two days of a rough machine, and where the watch stood after them."""
    rough = draw(SEED, 0, Rough())
    rig.begin()
    return rough, rig.days(rough, SEED, 0, range(2)), rig.watch.state, rig.watch.figures


def test_a_machine_rough_within_its_tolerances_is_silent(days) -> None:
    _, found, _, figures = days
    assert found.sensor is None
    assert figures["hours"] > 4.0
    assert (figures["since_s"], figures["sensor"], figures["phase"]) == (None, None, None)
    assert 0.0 < figures["rms_K"] < figures["allowed_K"]
    assert list(figures["per_sensor"]) == ["t1", "t2", "t3", "t4", "t5"]


@pytest.mark.parametrize("effect", ["end loss 0.5 W/K", "body on the nut", "bearing with twice its heat"])
def test_a_new_effect_is_reported_within_hours_by_a_sensor_beside_it(rig: Rig, days, effect: str) -> None:
    rough, _, state, _ = days
    rig.begin(state)
    found = rig.days(rough, SEED, 0, range(2, 3), effect)
    assert found.sensor in EFFECTS[effect][1]
    assert found.after_h < 3.0
    report = rig.watch.figures
    assert report["rms_K"] > 0.5
    assert report["since_s"] > 2 * 86_400.0
    assert report["phase"] in PHASES


def _frames(rig_day) -> list[FrameBlock]:
    machine = MachineModel.of(config_of(), learns=True)
    return list(frames_of_log(log_of(rig_day), machine.plan))


@pytest.fixture(scope="module")
def machine() -> MachineModel:
    return MachineModel.of(config_of(), learns=True)


@pytest.fixture(scope="module")
def inputs(machine: MachineModel):
    state, blocks = machine.drive.initial(), []
    for frames in frames_of_log(log_of(day(draw(SEED, 1, Rough()), SEED, 1, "a")), machine.plan):
        state, block = machine.drive.run(state, frames)
        blocks.append(block)
    return blocks


def _watch(machine: MachineModel) -> GapWatch:
    watch = machine.gap()
    assert watch is not None
    return watch


def test_nothing_is_reported_in_the_first_hour_of_work(machine: MachineModel, inputs) -> None:
    watch = _watch(machine)
    watch.take(inputs[0].part(0, 3000))
    assert watch.figures is None
    watch.take(inputs[0].part(3000))
    for block in inputs[1:]:
        watch.take(block)
    assert watch.figures["hours"] == pytest.approx(2.5, abs=0.2)


def test_a_sensor_that_was_never_read_has_no_gap(machine: MachineModel, inputs) -> None:
    """It has not agreed to 0 K."""
    watch = _watch(machine)
    for block in inputs:
        usable = block.usable.copy()
        usable[:, 1] = False
        watch.take(block._replace(usable=usable))
    per_sensor = watch.figures["per_sensor"]
    assert per_sensor["t2"] is None
    assert per_sensor["t1"] > 0.0


def test_a_gap_watch_fed_row_by_row_is_the_same_as_in_blocks(machine: MachineModel, inputs) -> None:
    whole, rows = _watch(machine), _watch(machine)
    part = inputs[0].part(0, 1400)
    whole.take(part)
    for k in range(len(part)):
        rows.take(part.part(k, k + 1))
    np.testing.assert_allclose(rows.state.x, whole.state.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rows.state.sums, whole.state.sums, rtol=1e-7, atol=1e-9)
    assert rows.state.time_s == whole.state.time_s == 1379.0


def test_phases_are_those_of_the_programme(machine: MachineModel, inputs) -> None:
    """Programme a: 10 min rest, 45 min, a dwell of 20 min, 55 min at two speeds, and 30 min to cool down."""
    watch = _watch(machine)
    for block in inputs:
        watch.take(block)
    minutes = dict(zip(PHASES, watch.state.sums[:, 0, 2] / 60.0, strict=True))
    assert 5.0 < minutes["isothermal"] <= 10.0
    assert 13.0 < minutes["dwell"] < 16.0  # 20 minutes, 85 before the end, fade with 4 h
    assert 24.0 < minutes["cool_down"] <= 30.5
    assert minutes["heat_up"] > 10.0
    assert minutes["steady"] > 5.0


def test_after_a_break_or_without_inputs_it_begins_again_and_keeps_what_it_learnt(
    machine: MachineModel, inputs
) -> None:
    watch = _watch(machine)
    watch.take(inputs[0].part(0, 1400))
    theta = watch.state.theta
    missing = inputs[1].part(0, 120)._replace(degraded=np.ones(120, np.int8))
    watch.take(missing)
    assert math.isnan(watch.state.time_s)
    assert np.abs(theta).max() > 0.02
    assert np.abs(watch.state.theta - theta).max() < 0.01  # what the last minute before it gave
    late = inputs[1].part(120, 300)
    watch.take(late)
    assert watch.state.time_s > 0.0
    before = watch.state
    watch.take(late._replace(time_s=late.time_s + 300.0 + BREAK_S))
    assert watch.state.sums[:, :, 2].sum() <= before.sums[:, :, 2].sum() + 180.0 * 5
    watch.reset()
    assert math.isnan(watch.state.time_s)


def test_a_checkpoint_holds_it_to_the_last_bit_and_continues(machine: MachineModel, inputs, tmp_path) -> None:
    estimator = machine.estimator()
    watch = _watch(machine)
    watch.take(inputs[0])
    fit = CheckpointFit.of(machine)
    snapshot = Snapshot(9.0, machine.drive.initial(), estimator.initial(), gap=watch.state)
    again = unpack(pack(snapshot, fit), fit).gap
    assert again.P.tobytes() == watch.state.P.tobytes()
    assert again.sums.tobytes() == watch.state.sums.tobytes()
    assert (again.time_s, again.sensor) == (watch.state.time_s, watch.state.sensor)
    assert unpack(pack(snapshot, fit), replace(fit, gap=None)).gap is None
    other = replace(fit, gap=replace(fit.gap, theta=np.zeros(3)))
    assert unpack(pack(snapshot, fit), other).gap is None
    write_whole(tmp_path / "old", pack(snapshot, fit))
    snapshot_again, known, _ = stored(tmp_path / "old", fit, 9.0 + 1e6, 900.0)
    assert snapshot_again is None  # it is too old to go on from, and the machine is the same
    assert math.isnan(known.time_s)
    assert (known.theta == watch.state.theta).all()
    assert stored(tmp_path / "none", fit, 10.0, 900.0) == (None, None, None)
    assert shifted(snapshot, 5.0).gap.time_s == watch.state.time_s + 5.0
    later = _watch(machine)
    later.restore(again)
    watch.take(inputs[1].part(0, 600))
    later.take(inputs[1].part(0, 600))
    assert watch.state.judged_s == pytest.approx(later.state.judged_s, abs=90.0)


def test_estimates_are_the_same_with_and_without_a_gap_watch(machine: MachineModel) -> None:
    estimator = machine.estimator()
    frames = _frames(day(draw(SEED, 1, Rough()), SEED, 1, "a"))[:2]
    with_it = machine.pipeline(estimator)
    without = Pipeline(machine.drive, estimator, machine.self_test())
    assert with_it.gap is not None
    for block in frames:
        one, other = with_it.step(block), without.step(block)
        for name in EstimateBlock.__dataclass_fields__:
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert with_it.gap.state.time_s > 0.0


def test_a_heat_without_a_law_cannot_be_predicted() -> None:
    text = RIG.joinpath("config.toml").read_text(encoding="utf-8")
    config = config_of(text)
    assert MachineModel.of(config).gap() is not None
    source = _without_a_law(config)
    assert MachineModel.of(source).gap() is None


def _without_a_law(config):
    """The configuration whose first heat is nobody's law."""
    first = config.source[0]
    bare = {
        key: None
        for key in ("speed_channel", "power_channel", "torque_Nm", "heat_W", "heat_W_rpm")
        if hasattr(first, key)
    }
    return config.model_copy(update={"source": (first.model_copy(update=bare), *config.source[1:])})


def test_the_reason_says_which_since_when_and_what_to_do() -> None:
    found = Departure("t3", 1.8e9, "heat_up", 1.84, 0.61)
    assert of_departure(found).sentence == (
        "the model's prediction has departed from sensor t3 since 2027-01-15 08:00 UTC, most while heating "
        "up: 1.8 K rms where its tolerances allow 0.6 K; run `observer discover --recent 8h`"
    )
    assert "since 7200 s," in of_departure(found._replace(since_s=7200.0)).sentence


def test_a_nut_failing_at_work_is_reported_by_a_replay_of_the_whole_day(tmp_path) -> None:
    """End to end: a log, the live path, the summary. The nut makes twice its heat from the third hour on, and
    the observer, which learns nothing here, goes on agreeing with its sensors.
    """
    rng, fails_s = stream(SEED, "nut"), 7500.0
    phases = (*programme("standard", "a", rng), *programme("standard", "b", rng))
    one = work(draw(SEED, 2, Rough()), phases, START_m["a"], rng, 0.0, fails_s)
    values = np.column_stack([one.sensor_degC, one.nut_m, one.speed_rpm, one.air_degC])
    write_log(tmp_path / "day.csv.gz", one.time_s, values)
    (tmp_path / "config.toml").write_text(CONFIG + '[estimator]\nengine = "constant"\n', encoding="utf-8")
    config = load(tmp_path / "config.toml")
    summary = observer.Machine(config, b"").replay(tmp_path / "day.csv.gz").summary
    first, *others = summary["gap"]["departures"]
    assert not others
    assert first["sensor"] in ("t2", "t3", "t4")
    assert fails_s < first["since_s"] < fails_s + 5400.0
    assert first["rms_K"] > 1.3 * first["allowed_K"] > 0.0
    assert max(s["innovation_rms_K"] for s in summary["sensors"].values()) < 0.5 * first["rms_K"]


def test_a_replay_reports_its_history(tmp_path) -> None:
    estimates = observer.load(RIG / "config.toml").replay(RIG / "run_c.csv.gz")
    estimates.write(tmp_path / "out")
    report = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))["gap"]
    assert report == estimates.summary["gap"]
    assert report["now"]["hours"] > 1.0
    assert report["departures"] == []
    assert 0.0 < report["most_of_allowed"] < 1.0
