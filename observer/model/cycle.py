"""A standard shift of a machine, for designs: the inputs of the plant in rest, work, dwell and cooling.

A design has no log, so the shift is the same for every machine: from cold, two hours of work with a dwell
between, and an hour at rest. Nuts sweep over their strokes, and rest in the middle. `ripple` is the reading
of sensors in a sweep beyond the nut's mean columns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config import Config
from observer.effects.terms import LawFactor, SpeedLoss
from observer.frames import FloatArray
from observer.kernels.path import SAMPLES_PER_TRAVERSE
from observer.model.law import heat_law
from observer.model.plant import AMBIENT, BED, LEFT, REFERENCE, RIGHT, Plant
from observer.model.realise import realise
from observer.model.rod.moving import NutTable, columns_at
from observer.model.rod.screw import surface_rate
from observer.tables.sections import Source, law_channels
from observer.units import ZERO_DEGC_K

PHASES = ("isothermal", "heat_up", "steady", "dwell", "cool_down")
DWELL_S = 1500.0
"""A standstill this short, with work after it, is a dwell."""
FAST = 0.15
"""Part of a run's fastest warming that still counts as heating up."""


_PLACES = 64
SWEEP_PHASES = 8
"""Number of phases of a sweep."""


class Sweep(NamedTuple):
    """A nut's motion to and fro between two places.

    Attributes:
        low_m: Lower end, m.
        high_m: Upper end, m.
        speed_m_s: Speed, m/s; at zero speed it rests midway.
    """

    low_m: float
    high_m: float
    speed_m_s: float

    @property
    def middle_m(self) -> float:
        """Middle of both ends, m."""
        return 0.5 * (self.low_m + self.high_m)


class Ripple(NamedTuple):
    """Readings of s sensors at f phases of a sweep beyond the mean, per W of the nut's heat.

    Attributes:
        reading: The reading, K/W, (f, s).
        by_place: Its change with the sensor's position, K/(W m), (f, s).
        by_lag: Its change with the sensor's lag, K/(W s), (f, s).
    """

    reading: FloatArray
    by_place: FloatArray
    by_lag: FloatArray


def ripple(
    table: NutTable,
    sweep: Sweep,
    decay_1_s: FloatArray,
    C: FloatArray,
    slope_C: FloatArray,
    lag_s: FloatArray,
) -> Ripple:
    """Return the readings of sensors in the periodic steady state of a sweep, by Fourier series.

    Each mode answers a harmonic by 1/(λ + iω), the column of the lag by g/(g + iω).

    Args:
        table: Table of the nut.
        sweep: Its motion, at a speed above zero.
        decay_1_s: Decay rates λ of the modes, 1/s, (N,).
        C: Rows of the sensors, (s, N).
        slope_C: Rows of ∂T/∂x at the sensors, 1/m, (s, N).
        lag_s: Lags of the sensors, s, (s,).
    """
    N, s = len(decay_1_s), len(C)
    way = np.abs((np.arange(_PLACES) + 0.5) / (_PLACES / 2) - 1.0)
    places = [columns_at(table, [x]) for x in (sweep.low_m + (sweep.high_m - sweep.low_m) * way).tolist()]
    B, of_lag = np.array([b[:N] for b, _ in places]), np.array([c[:s] for _, c in places])
    round_s = 2.0 * (sweep.high_m - sweep.low_m) / sweep.speed_m_s
    i_omega = 2j * np.pi * np.fft.rfftfreq(_PLACES, round_s / _PLACES)[1:, None]
    modes = np.fft.rfft(B, axis=0)[1:] / (decay_1_s + i_omega)
    dropped = np.fft.rfft(of_lag, axis=0)[1:] * table.lag_decay_1_s / (table.lag_decay_1_s + i_omega)
    reading = modes @ C.T + dropped
    lagging = reading * (-i_omega / (1.0 + i_omega * lag_s))

    def over_phases(harmonics: NDArray[np.complex128]) -> FloatArray:
        whole = np.fft.irfft(np.vstack([np.zeros((1, s)), harmonics]), _PLACES, axis=0)
        return np.asarray(whole.reshape(SWEEP_PHASES, -1, s).mean(axis=1))

    return Ripple(over_phases(reading), over_phases(modes @ slope_C.T), over_phases(lagging))


SPEED_RPM = 1000.0
"""Speed of a working machine, which only a log could show."""
AIR_degC = 20.0
"""Temperature of the air, if a channel measures it."""
RISE_K = 10.0
"""Rise for a film that grows with it."""
LEAD_M = 0.01
"""Default lead of a source."""
SHIFT = ((300.0, 0.0), (5400.0, 1.0), (600.0, 0.0), (1800.0, 1.0), (3600.0, 0.0))
"""Stretches of the shift: duration, s, and 1 if the machine works."""


class Stage(NamedTuple):
    """A stretch of time with constant inputs.

    Attributes:
        duration_s: Its length, s.
        law_W: Each source's heat by its law, W, (m,).
        heat_W: The heat taken as true, W, (m,); larger than the law's for a source without one.
        z: The known inputs, °C, (p,).
        loss_1_s: Rate of the losses by speed and by radiation, 1/s, the same along the screw.
        drawn_degC: The temperature that these losses approach, °C.
        sweeps: Motions of the moving sources, (M,); None if the samples do not resolve them.
    """

    duration_s: float
    law_W: FloatArray
    heat_W: FloatArray
    z: FloatArray
    loss_1_s: float
    drawn_degC: float
    sweeps: tuple[Sweep | None, ...]


def standard_shift(config: Config, plant: Plant) -> tuple[Stage, ...]:
    """Return the stages of the standard shift: 5 min rest, 90 min work, 10 min dwell, 30 min work, 60 min
    rest.

    The machine works at 1000 rpm in air at its constant temperature, or 20 °C. Meanwhile a source without a
    law, or with a law of a measured power, has its `initial_sigma_W`.

    Args:
        config: The machine.
        plant: Its model.
    """
    return tuple(_stage(config, plant, duration_s, share * SPEED_RPM) for duration_s, share in SHIFT)


def _stage(config: Config, plant: Plant, duration_s: float, speed_rpm: float) -> Stage:
    machine, works = realise(config), speed_rpm > 0.0
    sources, screw = machine.config.source, machine.config.screw
    law_W = np.array([_law_W(s, sources, screw.length_m, speed_rpm) for s in sources])
    for term in (t for t in machine.terms if isinstance(t, LawFactor)):
        j = plant.source_names.index(term.source)
        law_W[j] *= float(term.factor(np.array([speed_rpm]), np.array([duration_s]))[0])
    unknown_W = [s.initial_sigma_W if s.law is None and works else 0.0 for s in sources]
    air_degC = machine.config.ambient.temperature_degC
    air_degC = AIR_degC if air_degC is None else air_degC
    at_air = (AMBIENT, LEFT, RIGHT, BED, REFERENCE)
    z = np.array([air_degC if name in at_air else 0.0 for name in plant.known_names])
    losses = [
        (surface_rate(screw) * float(t.film_W_m2K(np.array([speed_rpm]))[0]), t.temperature_degC)
        for t in machine.terms
        if isinstance(t, SpeedLoss)
    ]
    losses.append((4.0 * plant.coupling.radiation * (air_degC + ZERO_DEGC_K) ** 3, None))
    losses.append((plant.coupling.rising * RISE_K**0.25, None))
    rate_1_s = sum(rate for rate, _ in losses)
    drawn = sum(rate * (air_degC if drawn_degC is None else drawn_degC) for rate, drawn_degC in losses)
    sweeps = tuple(_sweep(config, sources[m.index], speed_rpm) for m in plant.moving)
    return Stage(
        duration_s, law_W, law_W + unknown_W, z, rate_1_s, drawn / rate_1_s if rate_1_s else 0.0, sweeps
    )


def _sweep(config: Config, source: Source, speed_rpm: float) -> Sweep | None:
    """The motion of a nut; None if it is faster than the speed limit that `check` reports."""
    low_m, high_m = source.stroke_m or (0.0, config.screw.length_m)
    speed_m_s = speed_rpm / 60.0 * (source.lead_m or LEAD_M)
    sample_s = config.sample_s.get(source.position_channel or "", config.estimator.period_s)
    is_sampled = speed_m_s * sample_s * SAMPLES_PER_TRAVERSE <= high_m - low_m
    return Sweep(low_m, high_m, speed_m_s) if is_sampled else None


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
