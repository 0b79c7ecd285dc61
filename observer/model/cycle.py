"""The phases of a cycle, and a standard shift of a machine as inputs of its filter.

A design has no log, so the shift is the same for every machine: from cold, two hours of work with a dwell
between, and an hour at rest. Nuts that work are spread over their strokes; at rest they stand in the middle.
"""

from __future__ import annotations

import numpy as np

from observer.config.effects.terms import LawFactor, SpeedLoss
from observer.config.machine import Config
from observer.config.sections import Source, law_channels
from observer.frames import FloatArray, Inputs
from observer.model.law import heat_law
from observer.model.plant import AMBIENT, BED, LEFT, REFERENCE, RIGHT, Plant
from observer.model.realise import Realised, realise
from observer.model.rod.moving import columns_at
from observer.model.rod.screw import surface_rate
from observer.model.simulate import simulate, start

PHASES = ("isothermal", "heat_up", "steady", "dwell", "cool_down")
DWELL_S = 1500.0
"""A standstill this short, with work after it, is a dwell."""
FAST = 0.15
"""Part of a run's fastest warming that still counts as heating up."""

SPEED_RPM = 1000.0
"""Speed of a working machine, which only a log could show."""
AIR_degC = 20.0
"""Temperature of the air, if a channel measures it."""
LEAD_M = 0.01
"""Default lead of a source."""
SHIFT = ((300.0, 0.0), (5400.0, 1.0), (600.0, 0.0), (1800.0, 1.0), (3600.0, 0.0))
"""Stretches of the shift: duration, s, and 1 if the machine works."""


def standard_shift(config: Config, plant: Plant, dt_s: float) -> Inputs:
    """Return the standard shift: 5 min rest, 90 min work, 10 min dwell, 30 min work, 60 min rest.

    The machine works at 1000 rpm in air at its constant temperature, or 20 °C. Meanwhile a source without a
    law, or with a law of a measured power, has its `initial_sigma_W`. Readings are those of the plant,
    without noise.

    Args:
        config: The machine.
        plant: Its model.
        dt_s: Length of the steps, s; each stretch has the nearest whole number of them.
    """
    machine = realise(config)
    sources, s = machine.config.source, plant.rows.sensors
    works = np.concatenate([np.full(round(duration_s / dt_s), share) for duration_s, share in SHIFT])
    steps = len(works)
    air_degC = machine.config.ambient.temperature_degC
    air_degC = AIR_degC if air_degC is None else air_degC
    at_air = (AMBIENT, LEFT, RIGHT, BED, REFERENCE)
    z = np.tile([air_degC if name in at_air else 0.0 for name in plant.known_names], (steps, 1))
    rest, work = (_inputs(machine, plant, share, air_degC) for share in (0.0, 1.0))
    law_W, loss_1_s, loss_degC, B, C = (
        np.stack([a, b])[works.astype(int)] for a, b in zip(rest, work, strict=True)
    )
    no_law_W = np.array([one.initial_sigma_W if one.law is None else 0.0 for one in sources])
    u = Inputs(
        time_s=dt_s * np.arange(steps, dtype=np.float64),
        dt_s=np.append(0.0, np.full(steps - 1, dt_s)),
        y_degC=np.zeros((steps, s)),
        usable=np.ones((steps, s), np.bool_),
        quality=np.zeros((steps, s), np.int8),
        law_W=law_W,
        law_jump_W=np.diff(law_W, axis=0, prepend=law_W[:1]),
        z_start=z,
        z_end=z,
        moving_B=B,
        moving_C=C,
        degraded=np.zeros(steps, np.int8),
        loss_1_s=loss_1_s,
        loss_degC=loss_degC,
    )
    heat_W = law_W + works[:, None] * no_law_W
    _, rows = simulate(plant, start(plant, air_degC, heat_W[0]), u._replace(law_W=heat_W))
    return u._replace(y_degC=rows[:, :s].copy())


def _inputs(machine: Realised, plant: Plant, share: float, air_degC: float) -> tuple[FloatArray, ...]:
    """Return the inputs of a step: laws, rate and temperature of the losses by speed, columns of the nuts.

    The speed is a share of `SPEED_RPM`.
    """
    speed_rpm, sources, screw = share * SPEED_RPM, machine.config.source, machine.config.screw
    law_W = np.array([_law_W(one, sources, screw.length_m, speed_rpm) for one in sources])
    for term in (t for t in machine.terms if isinstance(t, LawFactor)):
        j = plant.source_names.index(term.source)
        law_W[j] *= float(term.factor(np.array([speed_rpm]), np.array([SHIFT[1][0]]))[0])
    losses = [
        (surface_rate(screw) * float(t.film_W_m2K(np.array([speed_rpm]))[0]), t.temperature_degC)
        for t in machine.terms
        if isinstance(t, SpeedLoss)
    ]
    rate_1_s = sum(rate for rate, _ in losses)
    drawn = sum(rate * (air_degC if degC is None else degC) for rate, degC in losses)
    B = np.zeros((len(plant.moving), len(plant.decay_1_s)))
    C = np.zeros((len(plant.moving), len(plant.rows.C)))
    for i, nut in enumerate(plant.moving):
        if share:
            B[i], C[i] = plant.B[:, nut.index], plant.rows.C[:, plant.modes + nut.index]
        else:
            low_m, high_m = sources[nut.index].stroke_m or (0.0, screw.length_m)
            B[i], C[i] = columns_at(nut.table, [0.5 * (low_m + high_m)])
    return law_W, np.array(rate_1_s), np.array(drawn / rate_1_s if rate_1_s else 0.0), B, C


def _law_W(source: Source, sources: tuple[Source, ...], screw_m: float, speed_rpm: float) -> float:
    """The heat by a source's law at a speed; a rotating nut turns half as fast."""
    works = speed_rpm > 0.0
    values = {s.power_channel: s.initial_sigma_W if works else 0.0 for s in sources}
    values |= {s.drive_channel: float(works) for s in sources}
    values |= {s.nut_speed_channel: 0.5 * speed_rpm for s in sources}
    read = [np.array([values.get(c, speed_rpm)]) for c in law_channels(source, sources)]
    if source.law is None:
        return 0.0
    return float(heat_law(source, sources, screw_m)(*(read or [np.zeros(1)]))[0])
