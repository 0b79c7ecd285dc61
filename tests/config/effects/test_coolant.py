"""Coolant in the bore: drawn towards what its inlet is measured to be, while the screw turns or always."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.effects.film import Coolant
from observer.config.machine import Config
from observer.discovery.candidates import library
from observer.errors import ConfigError, UserError
from observer.estimate.open_loop import OpenLoop
from observer.estimate.pipeline import MachineModel
from observer.export.exportable import refuse_unexportable
from observer.fit.hypothesis import fit_effects
from observer.frames import EstimateQuality, FloatArray, FrameBlock
from observer.installation import parse
from observer.kernels.codes import GOOD, INPUT_LOST, STALE
from observer.model.build import build_plant
from observer.model.drive import Drive
from tests.discovery.small import problem_of
from tests.learning.cooled import CONDUCTANCE_W_K, CONSTANT, EFFECT, MEASURED, cooled
from tests.learning.machines import AS_CONFIGURED, CONFIG, config_of
from tests.logs.machines import table
from tests.logs.simulated import frames, run_model
from tests.reference.test_effects import FORM_K, SHARE
from tests.truth.machine.sensing import NOISE_K

G_W_K, AIR_degC = 3.0, 20.0


def machine(**keys: Any) -> Config:
    return parse(table(effect=[{"kind": "coolant", "conductance_W_K": G_W_K} | keys]))


def driven(config: Config, inlet_degC: FloatArray, speed_rpm: FloatArray) -> tuple[Drive, FrameBlock]:
    """A drive, and frames of a machine whose coolant enters so warm."""
    columns = {"heater_W": np.full_like(speed_rpm, 10.0), "n_rpm": speed_rpm, "coolant_degC": inlet_degC}
    columns |= {s.channel: np.full_like(speed_rpm, AIR_degC) for s in config.sensor}
    return Drive(config, build_plant(config)), frames(config, 2.0 * np.arange(len(speed_rpm)), columns)


def test_heat_is_drawn_to_the_inlet_and_to_the_air_until_that_is_known() -> None:
    inlet_degC = np.array([np.nan, 12.0, 14.0, 16.0])
    drive, block = driven(machine(inlet_channel="coolant_degC"), inlet_degC, np.full(4, 500.0))
    u = drive.run(drive.initial(), block)[1]
    np.testing.assert_allclose(u.loss_degC, [AIR_degC, 12.0, 14.0, 16.0])
    steel_J_K = 0.4 * math.pi * 0.02**2 / 4 * 7800.0 * 460.0
    np.testing.assert_allclose(u.loss_1_s, G_W_K / steel_J_K)
    np.testing.assert_array_equal(u.degraded, [INPUT_LOST, GOOD, GOOD, GOOD])


def test_it_flows_while_the_screw_turns_or_always() -> None:
    speed_rpm, inlet_degC = np.array([0.0, 500.0, 0.0]), np.full(3, 12.0)
    for keys, flows in (({}, [False, True, False]), ({"while_standing": True}, [True] * 3)):
        drive, block = driven(machine(inlet_channel="coolant_degC", **keys), inlet_degC, speed_rpm)
        np.testing.assert_array_equal(drive.run(drive.initial(), block)[1].loss_1_s > 0.0, flows)


def test_a_coolant_that_always_flows_needs_no_speed() -> None:
    heater = [{"name": "heater", "shape": "point", "position_m": 0.1, "power_channel": "heater_W"}]
    own = {"kind": "coolant", "conductance_W_K": G_W_K, "inlet_degC": 12.0, "while_standing": True}
    assert parse(table(source=heater, effect=[own])).channels[-1] == "heater_W"
    with pytest.raises(ConfigError, match="its own speed_channel"):
        build_plant(parse(table(source=heater, effect=[own | {"while_standing": False}])))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, "give exactly one of inlet_degC and inlet_channel"),
        ({"inlet_degC": 12.0, "inlet_channel": "coolant_degC"}, "give exactly one"),
        ({"inlet_degC": 12.0, "while_standing": True, "speed_channel": "n_rpm"}, "whatever the speed"),
    ],
)
def test_what_does_not_go_together_is_refused(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError, match=said):
        machine(**keys)


def test_quality_falls_while_the_inlet_is_stale() -> None:
    config = machine(inlet_channel="coolant_degC")
    drive, block = driven(config, np.full(400, 15.0), np.full(400, 500.0))
    noise_K = 0.05 * np.random.default_rng(1).standard_normal((400, len(config.sensor)))
    values = block.values.copy()
    own = [block.channels.index(s.channel) for s in config.sensor]
    values[:, own] = run_model(build_plant(config), drive, block, AIR_degC)[1] + noise_K
    lost = np.outer(np.arange(400) >= 300, [name == "coolant_degC" for name in block.channels])
    quality = np.where(lost, STALE, block.quality).astype(np.int8)
    received = replace(block, values=values, fresh=block.fresh & ~lost, quality=quality)
    found = MachineModel.of(config).pipeline().step(received)
    assert (found.quality[250:300] == EstimateQuality.GOOD).all()
    assert (found.quality[300:] == EstimateQuality.DEGRADED).all()


def test_the_export_refuses_it_in_a_sentence() -> None:
    for keys in ({"inlet_channel": "coolant_degC"}, {"inlet_degC": 12.0, "while_standing": True}):
        with pytest.raises(
            UserError, match='effect "coolant" is a loss that changes with the speed or has a'
        ):
            refuse_unexportable(machine(**keys))


# ---- against the same physics, written anew in two dimensions ----


def open_loop_K(inlet: str) -> FloatArray:
    """How far the sensors of a machine that is as configured are from their prediction, (n, 5)."""
    one = cooled(3, 0, "a", AS_CONFIGURED, 0.0)
    config = config_of(CONFIG, EFFECT + inlet)
    plant, drive = MachineModel.of(config).plant, MachineModel.of(config).drive
    loop = OpenLoop(plant, drive, float(one.day.air_degC[0]))
    predicted = [loop.run(frames) for frames in frames_of_log(one.log, AlignPlan.of(config))]
    residuals_K = [
        np.where(inputs.usable, inputs.y_degC - rows[:, plant.rows.sensor_slice], np.nan)
        for inputs, rows in filter(None, predicted)
    ]
    return np.concatenate(residuals_K)


def test_a_measured_inlet_is_followed_as_the_machine_does() -> None:
    moved_K, followed_K = (np.sqrt(np.nanmean(open_loop_K(inlet) ** 2)) for inlet in (CONSTANT, MEASURED))
    assert moved_K > 0.4
    assert followed_K < math.hypot(FORM_K + SHARE * moved_K, NOISE_K)


def test_of_a_coolant_whose_inlet_is_measured_a_search_fits_the_conductance() -> None:
    """The configuration knows the channel and nothing of the flow."""
    one = cooled(3, 0, "a", AS_CONFIGURED, 0.0)
    config = config_of(CONFIG, EFFECT.replace(str(CONDUCTANCE_W_K), "0.0") + MEASURED)
    (candidate,) = [c for c in library(config, ()) if c.of is Coolant]
    assert list(candidate.fitted) == ["conductance_W_K"]
    more = config.model_copy(update={"effect": (*config.effect, candidate.effect(candidate.shapes[0]))})
    assert more.effect[1].inlet_channel == "coolant_degC"
    problem = problem_of(config, list(frames_of_log(one.log, AlignPlan.of(config))))
    fit = fit_effects(problem.with_nuisance(config), more, candidate.parameters(1))
    assert fit.values[0] == pytest.approx(CONDUCTANCE_W_K, abs=3.0 * fit.half_width[0] / 1.96 + 0.02)
