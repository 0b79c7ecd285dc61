"""The steady state of a plant under constant inputs, by a linear solve instead of a long run.

The equation on the screw is

    0 = A x + B q + E z + r (T_d − T)

with the plant's own generator A and a loss by speed of the rate r towards T_d. Nuts are over their strokes or
at given places. Radiation, which enters by its tangent, and fading friction are iterated to convergence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from observer.config.effects.terms import AmbientShift
from observer.config.machine import Config
from observer.config.sections import covers_only, law_channels
from observer.errors import ConfigError, meant
from observer.frames import FloatArray, FrameBlock, Inputs, Quality
from observer.kernels.coupling import uniform_loss
from observer.model.coupling import Coupling
from observer.model.drive import Drive
from observer.model.generator import generator, on_the_screw
from observer.model.plant import Plant
from observer.model.realise import realise
from observer.model.rod.moving import columns_at

SLOWEST_1_S = 1e-8
"""Slower states (three years) are rounding errors of undamped ones."""
_STILL = 1e-12
_ROUNDS = 200
_LARGEST = 1e9
_LONG_S = 1e9  # what fades with the hours has faded


class OperatingPoint(NamedTuple):
    """Constant inputs.

    Attributes:
        law_W: Heats by law, (m,).
        z: Known inputs, (p,).
        loss_1_s: Rate of the loss by speed.
        loss_degC: The temperature that this loss approaches.
        moving_B: Input columns of the nuts, (M, n_x).
        moving_C: Output columns of the nuts, (M, R).
    """

    law_W: FloatArray
    z: FloatArray
    loss_1_s: float
    loss_degC: float
    moving_B: FloatArray
    moving_C: FloatArray


class SettledPlant(NamedTuple):
    """A plant at rest.

    Attributes:
        x: Its states, (n_x,).
        rows: Output rows in °C and µm, (R,).
        heat_W: The heats, with their fading, (m,).
        slowest_s: Time constant of the slowest state.
    """

    x: FloatArray
    rows: FloatArray
    heat_W: FloatArray
    slowest_s: float


def needed_channels(config: Config) -> tuple[str, ...]:
    """Return the channels that a steady state needs values of: all inputs of the model except positions.

    Sensors' channels are needed only if a law reads them. A nut without a position runs over its stroke.
    """
    machine = realise(config).config
    spare = config.sensor_channels | {s.position_channel for s in machine.source}
    by_law = {c for s in machine.source for c in law_channels(s, machine.source)}
    return tuple(c for c in config.channels if c not in spare or c in by_law)


def check_inputs(config: Config, values: Mapping[str, Any], place: str) -> None:
    """Check the values of channels.

    Args:
        config: The machine.
        values: Values by channel, as read from a file or an argument.
        place: Where they come from, as errors name it.

    Raises:
        ConfigError: If a channel is not an input of the model, or its value not a finite number.
    """
    sensors = config.sensor_channels
    inputs = [c for c in config.channels if c not in sensors]
    for channel, value in values.items():
        if channel not in inputs:
            raise ConfigError(
                f'{place}: the model reads no input "{channel}"{meant(channel, inputs)}; it reads '
                f"{', '.join(inputs) or 'none'}"
            )
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _LARGEST:
            raise ConfigError(f"{place}: {channel} = {value!r} is no number that can last; give one")


def point_of(config: Config, plant: Plant, values: Mapping[str, float]) -> OperatingPoint:
    """Return the operating point at which channels have constant values.

    Effects that fade with the running time have faded.

    Args:
        config: The machine.
        plant: Its model.
        values: Values by channel. A nut is at the value of its position channel, or runs over its whole
            stroke without one.

    Raises:
        ConfigError: If an input has no value, if the air drifts, or if a nut that covers the film leaves the
            screw.
    """
    refuse_drift(config)
    if missing := [c for c in needed_channels(config) if c not in values]:
        raise ConfigError(
            f"the steady state needs a value of {', '.join(missing)}; give each a constant value"
        )
    for source in config.source:
        place_m = values.get(source.position_channel or "")
        if source.covers_film and place_m is not None and not covers_only(source, config.screw, place_m):
            raise ConfigError(
                f"{source.position_channel} = {place_m:g}: {source.name} reaches beyond the screw there; "
                "covers_film needs the whole of it on the screw, so give another position"
            )
    driving = Drive(config, plant).open_loop(_constant_frames(config.channels, values))
    B = np.array([plant.B[:, m.index] for m in plant.moving]).reshape(-1, len(plant.decay_1_s))
    C = np.array([plant.rows.C[:, plant.modes + m.index] for m in plant.moving]).reshape(
        -1, len(plant.rows.C)
    )
    for i, nut in enumerate(plant.moving):
        if nut.channel in values:
            B[i], C[i] = columns_at(nut.table, [values[nut.channel]])
    loss_1_s, loss_degC = float(driving.loss_1_s[-1]), float(driving.loss_degC[-1])
    return OperatingPoint(driving.law_W[-1], driving.z_end[-1], loss_1_s, loss_degC, B, C)


def refuse_drift(config: Config) -> None:
    """Refuse a machine whose air drifts without end, so that nothing settles.

    Raises:
        ConfigError: If an effect lets the air drift.
    """
    if any(isinstance(t, AmbientShift) and t.rate_K_h for t in realise(config).terms):
        raise ConfigError(
            "there is no steady state while an [[effect]] lets the air drift; remove it, or set rate_K_h = 0"
        )


def _constant_frames(channels: tuple[str, ...], values: Mapping[str, float]) -> FrameBlock:
    """Three frames of the same values, far apart, so that effects that fade while running have faded."""
    row = np.array([values.get(c, np.nan) for c in channels])
    shape = (3, len(channels))
    return FrameBlock(
        channels=channels,
        time_s=np.zeros(3),  # at which nothing has drifted
        dt_s=np.array([0.0, _LONG_S, _LONG_S]),
        values=np.tile(row, (3, 1)),
        fresh=np.ones(shape, np.bool_),
        quality=np.full(shape, Quality.GOOD, np.int8),
        age_s=np.zeros(shape),
        path={},
    )


def mean_point(plant: Plant, blocks: Sequence[Inputs]) -> OperatingPoint:
    """Return the mean of a plant's inputs over some steps.

    It gives the average of a linear plant that repeats these steps and has settled. The column of a nut is
    the mean weighted by its heat.

    Args:
        plant: The model.
        blocks: Consecutive blocks of inputs; steps with unknown inputs are left out.
    """
    dt_s, law_W, z_start, z_end, B, C, loss_1_s, loss_degC = (
        np.concatenate([getattr(block, name) for block in blocks])
        for name in ("dt_s", "law_W", "z_start", "z_end", "moving_B", "moving_C", "loss_1_s", "loss_degC")
    )
    is_complete = np.isfinite(law_W).all(axis=1) & np.isfinite(z_start).all(axis=1) & (dt_s > 0.0)
    share = np.where(is_complete, dt_s, 0.0) / dt_s[is_complete].sum()
    law_W, z = (
        np.where(is_complete[:, None], law_W, 0.0),
        np.where(is_complete[:, None], 0.5 * (z_start + z_end), 0.0),
    )
    nuts_W = np.abs(law_W[:, [m.index for m in plant.moving]])
    heated = share[:, None] * nuts_W
    weight = np.where(heated.sum(axis=0) > 0.0, heated, share[:, None])
    weight = weight / weight.sum(axis=0)
    rate = float(share @ loss_1_s)
    drawn = float(share @ (loss_1_s * loss_degC))
    return OperatingPoint(
        share @ law_W,
        share @ z,
        rate,
        drawn / rate if rate else 0.0,
        np.einsum("km,kmn->mn", weight, B),
        np.einsum("km,kmr->mr", weight, C),
    )


def settled(plant: Plant, point: OperatingPoint) -> SettledPlant:
    """Return the steady state of a plant at an operating point.

    Args:
        plant: The model.
        point: Constant inputs.

    Raises:
        ConfigError: If no heat leaves the machine, or if fading heats find no balance.
    """
    plant = _at_point(plant, point)
    c, A_1_s, screw = plant.coupling, generator(plant), on_the_screw(plant)
    x: FloatArray = plant.uniform * float(point.z[plant.known.ambient])
    heat_W = point.law_W
    for _ in range(_ROUNDS):
        rate_1_s, drawn = uniform_loss(c, point.loss_1_s, point.loss_degC, float(point.z[c.ambient]), x)
        A = A_1_s - rate_1_s * screw
        slowest_1_s = _slowest_1_s(A)
        lost = drawn * _uniform_effect(plant, screw)
        driven = plant.B @ heat_W + plant.E @ point.z + lost
        after = np.asarray(np.linalg.solve(-A, driven), np.float64)
        heat_after_W = 0.5 * (heat_W + point.law_W * _faded(plant, after, point.z))
        moved = np.abs(np.concatenate([plant.rows.C @ (after - x), heat_after_W - heat_W])).max()
        x, heat_W = after, heat_after_W
        if moved <= _STILL * max(1.0, float(np.abs(plant.rows.C @ x).max())):
            return SettledPlant(x, plant.rows.C @ x + plant.rows.F @ point.z, heat_W, 1.0 / slowest_1_s)
    raise ConfigError(
        "there is no steady state: the heats that fade as the screw warms find no balance; lower per_K of "
        'the [[effect]] "friction_fade"'
    )


def _uniform_effect(plant: Plant, screw: FloatArray) -> FloatArray:
    """The effect (n_x,) of a loss towards 1 °C, per unit of its rate."""
    c = plant.coupling
    return np.asarray(screw @ c.uniform) if len(c.uneven.rate) else c.uniform


def _slowest_1_s(A_1_s: FloatArray) -> float:
    """The rate of the slowest state. Raises `ConfigError` if it is a rounding error."""
    slowest_1_s = float(np.min(-np.linalg.eigvals(A_1_s).real))
    if slowest_1_s < SLOWEST_1_S:
        raise ConfigError(
            "nothing takes the heat away, so there is no steady state; give surface.convection_W_m2K, a "
            "convective or prescribed end, or links to the ambient"
        )
    return slowest_1_s


def _at_point(plant: Plant, point: OperatingPoint) -> Plant:
    """The plant with the columns of nuts at the point.

    A nut that sweeps over less than its stroke exchanges less with its nodes beyond the mean, as in
    `kernels.coupling`.
    """
    B, C, c = plant.B.copy(), plant.rows.C.copy(), plant.coupling
    rate_1_s = c.spreads.rate_1_s.copy()
    for i, nut in enumerate(plant.moving):
        j = nut.index
        B[:, j], C[:, plant.modes + j] = point.moving_B[i], point.moving_C[i]
        shapes = slice(*c.spreads.first[j : j + 2])
        if shapes.start < shapes.stop:
            size = c.place_gain[j] ** 2 * _product(c, B[:, j], B[:, j])
            now, at_rest = (c.spreads.swept[j] / s for s in (size, c.spreads.at_rest[j]))
            rate_1_s[shapes] *= min(max((now**2 - at_rest**2) / (1.0 - at_rest**2), 0.0), 1.0)
    coupling = c._replace(spreads=c.spreads._replace(rate_1_s=rate_1_s))
    return replace(plant, B=B, rows=replace(plant.rows, C=C), coupling=coupling)


def _product(c: Coupling, x: FloatArray, y: FloatArray) -> float:
    """The scalar product of two states over the screw's modes."""
    return float(x[: c.modes] @ y[: c.modes] if not len(c.metric) else x @ c.metric @ y)


def _faded(plant: Plant, x: FloatArray, z: FloatArray) -> FloatArray:
    """The factors (m,) on the laws of heats that fade with the temperature under them."""
    c = plant.coupling
    under_degC = c.under_C @ x + c.under_F @ z
    for j in np.flatnonzero(c.fades.per_K):
        under_degC[j] += c.conductance_W_m * c.place_gain[j] * _product(c, plant.B[:, j], x)
    return np.exp(-c.fades.per_K * (under_degC - c.fades.reference_degC))
