"""Ticks on memory that lives on give the bits of whole blocks; what they hand out is nobody's scratch."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest

from observer.align.aligner import Aligner, frames_of_log
from observer.estimate.pipeline import MachineModel, Pipeline
from observer.estimators import fixed_gain
from observer.files.logs import read_log
from observer.frames import EstimateBlock, FrameBlock, Inputs, Reading
from observer.installation import parse
from observer.model.drive import Drive
from tests.estimate.test_handed_out import arrays_in
from tests.logs.machines import SCREW
from tests.logs.recordings import play, write

BEARING = {
    "type": "angular_contact",
    "mean_diameter_m": 0.04,
    "load_N": 800.0,
    "f1": 0.001,
    "viscosity_mm2_s": 30.0,
}
NUT = {"name": "nut", "shape": "nut", "length_m": 0.08, "stroke_m": [0.2, 0.8], "torque_Nm": 0.3,
       "share": 0.5,
       "lead_m": 0.02, "position_channel": "nut_position_m", "speed_channel": "screw_speed_rpm"}  # fmt: skip
POINT = {"shape": "point", "position_m": 0.0}
SPEED = {"speed_channel": "screw_speed_rpm"}
SOURCES = [
    NUT,
    POINT | SPEED | {"name": "one_number", "heat_W_rpm": 0.006},
    POINT | SPEED | {"name": "palmgren", "position_m": 1.0, "bearing": BEARING},
    POINT | {"name": "measured", "position_m": 0.5, "power_channel": "motor_W", "scale": 0.3},
    POINT | {"name": "constant", "position_m": 0.9, "heat_W": 2.0},
    POINT | {"name": "stops", "position_m": 0.1, "heat_W": 2.0, "drive_channel": "screw_speed_rpm"},
    POINT | {"name": "part", "position_m": 0.3, "heat_of": "one_number", "heat_ratio": 3.0},
]
EFFECTS = [
    {"kind": "speed_convection", "gain": 1.0},
    {"kind": "ambient_drift", "rate_K_h": 3.0},
    {"kind": "run_in", "target": "one_number", "fraction": 0.3, "time_s": 300.0},
    {"kind": "dwell", "target": "nut", "fraction": 0.2},
]
GAP = {"mounting": "L-III", "stiffness_first_N_m": 1e8, "stiffness_second_N_m": 1e8, "gap_m": 2e-6,
       "preload_N": 100.0}  # fmt: skip
PLAIN = {
    "screw": SCREW | {"expansion_1_K": 11.8e-6},
    "surface": {"convection_W_m2K": 15.0},
    "ambient": {"channel": "ambient_degC"},
    "source": [NUT, SOURCES[1]],
    "sensor": [{"name": f"t{i}", "channel": f"t{i}_degC", "position_m": x_m, "noise_K": 0.05}
               for i, x_m in enumerate((0.05, 0.28, 0.5, 0.72, 0.95))],
}  # fmt: skip
TABLES = {
    "plain": {},
    "laws": {"source": SOURCES},
    "effects": {"effect": EFFECTS},
    "still air": {"effect": [{"kind": "natural_convection", "coefficient_W_m2K": 8.0}]},
    "learning": {"tolerance": {}},
    "learning, with a limit of the bound": {"tolerance": {}, "integrity": {"limit_um": 1000.0}},
    "supports with a gap": {"supports": GAP},
    "pre-stretched, and learning": {"supports": GAP | {"gap_m": 0.0}, "tolerance": {}},
    "constant gain": {"estimator": {"engine": "constant"}},
    "luenberger": {"estimator": {"kind": "luenberger"}},
    "filterpy": {"estimator": {"engine": "filterpy"}},
}


def machine_of(name: str) -> MachineModel:
    return MachineModel.of(parse(PLAIN | TABLES[name]), learns="learning" in name)


def events(ticks: int) -> list[Reading | float]:
    """Seconds after the event before, as `play` takes them: a nut to and fro, faults, many rows at once."""
    rng, found = np.random.default_rng(3), []
    for k in range(ticks):
        for j in range(25 if k == 20 else 5):  # once more rows wait than ever before
            moving = {"nut_position_m": 0.5 + 0.3 * math.sin(0.3 * k + 0.06 * j)}
            found.append(
                Reading(0.07, moving | ({"screw_speed_rpm": 1500.0 if k % 30 > 8 else 0.0} if k > 3 else {}))
            )
        values = {f"t{i}_degC": 22 + rng.normal(0, 0.05) + 0.002 * k for i in range(5)}
        values |= {"motor_W": 40.0 + k, "ambient_degC": 22 + rng.normal(0, 0.01)}
        found += [
            Reading(0.05, values, {"t2_degC": "open_circuit"} if k % 11 == 3 else {}),
            rng.uniform(0.01, 0.2),
        ]
    return found


def of_channels(machine: MachineModel, ticks: int) -> list[Reading | float]:
    """The same, as far as a machine has the channels."""
    known = set(machine.plan.channels)
    return [
        e
        if isinstance(e, float)
        else Reading(e.time_s, {n: v for n, v in e.values.items() if n in known}, e.faults)
        for e in events(ticks)
    ]


@pytest.mark.parametrize("name", TABLES)
def test_ticks_give_the_bits_of_whole_blocks(name, tmp_path):
    machine = machine_of(name)
    channels, ticks = machine.plan.channels, 12 if name == "filterpy" else 70
    frames, recording = play(of_channels(machine, ticks), Aligner(machine.plan), channels)
    built = machine.estimator()
    live, blocks = machine.pipeline(built), machine.pipeline(built)
    log = read_log(write(tmp_path, recording), channels)
    one, inputs = [], []
    for frame in frames:
        one.append(live.step(frame))
        inputs.append(live.inputs)
    other = [blocks.step(block) for block in frames_of_log(log, machine.plan, 19)]
    for field in fields(EstimateBlock):
        a, b = (np.concatenate([getattr(e, field.name) for e in found]) for found in (one, other))
        assert a.tobytes() == b.tobytes(), field.name
    for a, b in zip(Inputs.joined(inputs[-len(other[-1]) :]), blocks.inputs, strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.isfinite(one[-1].heat_W).all()
    assert live.findings == blocks.findings
    assert live.history == blocks.history
    for a, b in zip(arrays_in(live.snapshot()), arrays_in(blocks.snapshot()), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_tick_and_blocks_may_follow_each_other():
    machine = machine_of("effects")
    frames, _ = play(of_channels(machine, 40), Aligner(machine.plan), machine.plan.channels)
    built = machine.estimator()
    ticks, mixed = machine.pipeline(built), machine.pipeline(built)
    plain, resumed, fresh = (Pipeline(machine.drive, built) for _ in range(3))
    for k, frame in enumerate(frames):
        if k == 25:
            resumed.restore(*plain.snapshot())
        one, other = ticks.step(frame), mixed.step(in_arrays(frame) if k % 3 == 1 else frame)
        assert same(one, other), k
        untested = plain.step(frame)
        assert k < 25 or same(untested, resumed.step(frame)), k
    plain.reset()
    fresh.restore(plain.snapshot()[0], built.initial())
    assert same(plain.step(frames[-1]), fresh.step(frames[-1]))


def in_arrays(frame: FrameBlock) -> FrameBlock:
    """A frame as one that has not come from a walk."""
    return FrameBlock(*(getattr(frame, field.name) for field in fields(frame)))


def same(one: EstimateBlock, other: EstimateBlock) -> bool:
    return all(getattr(one, f.name).tobytes() == getattr(other, f.name).tobytes() for f in fields(one))


@pytest.mark.parametrize("part", ["law", "gain"])
def test_a_step_that_fails_leaves_the_parts_where_they_were(part, monkeypatch):
    machine = machine_of("constant gain" if part == "gain" else "effects")
    frames, _ = play(of_channels(machine, 30), Aligner(machine.plan), machine.plan.channels)
    built = machine.estimator()
    failing, sound = machine.pipeline(built), machine.pipeline(built)
    for k, frame in enumerate(frames):
        if k in (0, 9, 10):
            with monkeypatch.context() as broken:
                break_down(broken, part)
                with pytest.raises(ZeroDivisionError):
                    failing.step(frame)
            continue
        assert same(failing.step(frame), sound.step(frame)), k
    for a, b in zip(arrays_in(failing.snapshot()), arrays_in(sound.snapshot()), strict=True):
        np.testing.assert_array_equal(a, b)


def break_down(patch: pytest.MonkeyPatch, part: str) -> None:
    """Have a step fail in its midst: when the drive has been moved, or the estimator as well."""

    def fail(*_):
        raise ZeroDivisionError

    if part == "law":
        patch.setattr(Drive, "loss", fail)
    else:
        run = fixed_gain.run_fixed_gain
        patch.setattr(fixed_gain, "run_fixed_gain", lambda *given: fail(run(*given)))


@pytest.mark.parametrize("kind", ["plain", "constant gain", "learning"])
def test_nothing_that_a_tick_handed_out_is_written_to_again(kind):
    machine = machine_of(kind)
    frames, _ = play(of_channels(machine, 30), Aligner(machine.plan), machine.plan.channels)
    pipeline, seen, copies = machine.pipeline(machine.estimator()), [], []
    for frame in frames:
        out = [frame, pipeline.step(frame)]
        out += [pipeline.inputs, pipeline.snapshot()]
        whole = list(arrays_in(out))
        seen.append(whole)
        copies.append([array.copy() for array in whole])
    for arrays, as_they_were in zip(seen, copies, strict=True):
        for array, as_it_was in zip(arrays, as_they_were, strict=True):
            np.testing.assert_array_equal(array, as_it_was)


def test_an_estimate_is_cut_out_when_it_is_asked_for_and_only_then():
    machine = machine_of("plain")
    frames, _ = play(of_channels(machine, 12), Aligner(machine.plan), machine.plan.channels)
    pipeline = machine.pipeline(machine.estimator())
    estimates = [pipeline.step(frame) for frame in frames]
    late = [estimate.field_degC for estimate in estimates]
    assert len({field.tobytes() for field in late if np.isfinite(field).all()}) > 5
    with pytest.raises(AttributeError, match="EstimateBlock has no field_K"):
        estimates[0].field_K  # noqa: B018
