"""What the tolerances of a configuration do to the sensors over a log whose heats are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from observer.config import Config
from observer.fit.forward import lean_config
from observer.fit.tolerance import heat_tolerances
from observer.frames import FloatArray, FrameBlock, Inputs
from observer.history.within import Change
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start_from_sensors


def changes_within(config: Config, frames: Sequence[FrameBlock], heat_W: FloatArray) -> list[Change]:
    """Return what one standard deviation of each tolerance does to the sensors, s of them.

    `frames` are consecutive blocks of K together; `heat_W` (K, m_e) the estimated heats, NaN where they are
    not known: the change is taken along them, since a film's goes with how warm the screw was. Each start is
    the one that the sensors' first values tell. Learnt is what `[estimator] learn` names; what changes
    nothing is left out.
    """
    if not np.isfinite(heat_W).all(axis=1).any():
        return []
    lean, own = lean_config(config, len(build_plant(config).mode_index)), np.eye(len(config.sensor))
    here, air_degC = _predicted(lean, frames, heat_W)
    found = list[tuple[FloatArray, str]]()
    for changed, key in heat_tolerances(lean):
        change = _predicted(changed, frames, heat_W)[0] - here
        of_sensors = key in ("position_m", "lag_s")
        found += [(change * sensor, key) for sensor in own] if of_sensors else [(change, key)]
    for declared, sensor in zip(config.sensor, own, strict=True):
        found.append((config.tolerance.gain * (air_degC[:, None] - here) * sensor, "gain"))
        offset_K = config.tolerance.offset_of_K(declared.offset_K)
        found.append((np.tile(offset_K * sensor, (len(here), 1)), "offset_K"))
    return [Change(change, key in config.estimator.learn) for change, key in found if change.any()]


def _predicted(
    config: Config, frames: Sequence[FrameBlock], heat_W: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The sensors (K, s) with heats (K, m_e) in place of the laws', and the air (K,), °C; the sensors stay as
    they are up to the first row that holds all that is needed.
    """
    plant = build_plant(config)
    drive, s = Drive(config, plant), plant.rows.sensors
    state, blocks = drive.initial(), []
    for block in frames:
        state, inputs = drive.run(state, block)
        blocks.append(inputs)
    u = _filled(Inputs.joined(blocks))
    law_W = u.law_W.copy()
    law_W[:, plant.estimated] = _held(heat_W)
    seen = np.where(u.usable, u.y_degC, np.nan)
    ready = np.isfinite(u.z_end).all(axis=1) & np.isfinite(seen).any(axis=1)
    first = int(np.argmax(ready))
    start = start_from_sensors(plant, seen[first], plant.noise_R_K2, law_W[first], u.z_end[first])
    before = plant.rows.C @ start.x + plant.rows.F @ u.z_end[first]
    rows = simulate(plant, start, u._replace(law_W=law_W).part(first + 1))[1]
    sensor_degC = np.vstack([np.tile(before[:s], (first + 1, 1)), rows[:, :s]])
    return sensor_degC, u.z_end[:, plant.known.ambient]


def _filled(u: Inputs) -> Inputs:
    """The inputs, those of a step that is not wholly known as they were before it."""
    driving = ("z_start", "z_end", "moving_B", "moving_C", "loss_1_s", "loss_degC")
    columns = {name: getattr(u, name) for name in driving}
    known = np.all([np.isfinite(c).reshape(len(u), -1).all(axis=1) for c in columns.values()], axis=0)
    last = np.maximum.accumulate(np.where(known, np.arange(len(u)), np.argmax(known)))
    return u._replace(law_W=_held(u.law_W), **{name: c[last] for name, c in columns.items()})


def _held(values: FloatArray) -> FloatArray:
    """Rows (K, m), each that is not known as the last known one, or the first."""
    known = np.isfinite(values).all(axis=1)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), np.argmax(known)))
    return np.asarray(np.nan_to_num(values[last]))
