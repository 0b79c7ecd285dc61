"""Every effect of the library, by hand in `[[effect]]`, against its physics written anew in two dimensions.

The machine of `tests/truth/machine` is exactly as its configuration says; then the strongest effect of each
ladder is put into both. What the effect changes at the sensors, in hours of open-loop prediction, has to be
what it changes in the machine.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.config.machine import Config
from observer.files.logs import read_log
from observer.fit.runs import joined
from observer.frames import FloatArray
from observer.installation import parse
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from tests.truth.machine.effects import LADDERS, Ladder, apply
from tests.truth.machine.generate import Case, logged, trace
from tests.truth.machine.logs import configuration, write_log
from tests.truth.machine.machine import Machine, plain_machine
from tests.truth.machine.physics import LEFT

FORM_K = 0.03
"""What two dimensions and the passing nut add to one dimension without any effect, rms over all sensors."""
SHARE = 0.015
"""Part of an effect's own change that its form in one dimension may miss, rms."""
CLOSER = {"radiation": 0.007}
"""The same where more is known: radiation by the mean temperature alone misses 0.009."""


def machine_without(case: Case) -> Machine:
    """The machine as configured: without the film or the bearing that the effect stands for."""
    machine = plain_machine()
    physics = machine.physics
    if "film" in case.unmodelled:
        physics = physics._replace(film_W_m2K=np.zeros_like(physics.film_W_m2K))
    friction = physics.friction_W_rpm.copy()
    for index, name in enumerate(("left_bearing", "right_bearing")):
        if name in case.unmodelled:
            friction[LEFT + index] = 0.0
    return replace(machine, physics=physics._replace(friction_W_rpm=friction))


def predicted(config: Config, log: Path) -> FloatArray:
    """The open-loop prediction of the sensors at the rows of a log, from a screw as warm as the air."""
    frames = joined(list(frames_of_log(read_log(log), AlignPlan.of(config))))
    plant = build_plant(config)
    drive = Drive(config, plant)
    inputs = drive.run(drive.initial(), frames)[1]
    rows = simulate(plant, start(plant, float(inputs.z_end[0, 0]), inputs.law_W[0]), inputs)[1]
    return rows[:, plant.rows.sensor_slice]


def changes(ladder: Ladder, folder: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the strongest effect of a ladder changes at the sensors, (n, 5): in the machine and by the model;
    and what the model has beyond the machine with it.
    """
    effect = ladder.effect(4)
    case = Case("effects", (effect,), seed=3, cycle=ladder.cycle)
    plain = machine_without(case)
    truth = plain if effect.kind != "surface_convection" else plain_machine()
    without = trace(replace(case, effects=()), "a", plain)
    with_it = trace(replace(case, effects=()), "a", apply(truth, effect))
    run = logged(replace(case, effects=()), "a", without)
    log = folder / f"{ladder.label}.csv.gz"
    write_log(log, run.time_s, run.values)
    table = tomllib.loads(configuration(case.unmodelled))
    target = {} if effect.target is None else {"target": effect.target}
    own = {"kind": effect.kind, **target, **effect.parameters}
    bare, full = predicted(parse(table), log), predicted(parse(table | {"effect": [own]}), log)
    row = np.round(run.time_s / 0.5).astype(int)
    true_bare, true_full = without.reading_degC[row], with_it.reading_degC[row]
    return true_full - true_bare, full - bare, full - true_full


def rms_K(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("ladder", LADDERS, ids=lambda ladder: ladder.label)
def test_an_effect_does_in_the_model_what_it_does_in_the_machine(ladder: Ladder, tmp_path: Path) -> None:
    true_K, model_K, error_K = changes(ladder, tmp_path)
    missed_K = rms_K(model_K - true_K)
    print(f"changes {rms_K(true_K):.2f} K, missed {missed_K:.3f} K, all in all {rms_K(error_K):.3f} K off")
    assert rms_K(true_K) > 0.3
    assert missed_K < CLOSER.get(ladder.kind, SHARE) * rms_K(true_K)
    assert rms_K(error_K) < FORM_K + SHARE * rms_K(true_K)
