"""Reduce the full model of a screw to a plant of few modes.

Dropped modes settle faster than those that are kept. Each heat has one lag for all of them, whose output
column is their steady response in closed form: the field at rest is exact. For known
inputs (ambient, prescribed ends) it is an output column of the input itself. The output rows are temperature
and thermal error at a place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray, Layout
from observer.model.caching import cached
from observer.model.coupling import no_coupling
from observer.model.network import Exchange, past_heat_covariance, smooth_field_covariance
from observer.model.plant import (
    AMBIENT,
    BED,
    LEFT,
    OFFSET,
    REFERENCE,
    RIGHT,
    Following,
    MovingSource,
    OutputRows,
    Plant,
)
from observer.model.rod.modes import (
    Modes,
    Stretch,
    modal_input,
    nut_stretch,
    quadrature,
)
from observer.model.rod.moving import TABLE_POINTS, NutTable
from observer.model.rod.supports import Restraint, restrained_rows
from observer.model.steady import Field, ScrewAtRest, mean_over

UM_PER_M = 1e6
LEAST_COSINES = 96
"""How many cosines a nut's columns of a screw with sections have at least."""


class Places(NamedTuple):
    """Places and scales of the output rows.

    Attributes:
        sensor_m: Positions of the sensors, (s,).
        grid_m: Positions of the grid, (g,).
        expansion_1_K: Expansion coefficient of the error's rows.
        length_m: Length of the screw.
        restraint: Supports of the screw; None if it grows freely from x = 0.
        bed_1_K: Expansion coefficient of the bed from which the error is measured; 0 for a rigid bed.
        moved: Numbers of the sensors that read the thermal error at their places, µm, (d,).
        moved_restraint: Supports of the screw at these sensors.
    """

    sensor_m: FloatArray
    grid_m: FloatArray
    expansion_1_K: float | None
    length_m: float
    restraint: Restraint | None = None
    bed_1_K: float = 0.0
    moved: tuple[int, ...] = ()
    moved_restraint: Restraint | None = None

    @property
    def temperature_m(self) -> FloatArray:
        """Places of the rows that are temperatures: sensors, then grid."""
        return np.concatenate([self.sensor_m, self.grid_m])

    @property
    def growth_m(self) -> FloatArray:
        """Ends of the intervals of growth: the grid, then the screw's end."""
        return np.append(self.grid_m, self.length_m)

    @property
    def moved_m(self) -> FloatArray:
        """Ends of the intervals of growth for displacement sensors: their places, then the screw's end."""
        return np.append(self.sensor_m[list(self.moved)], self.length_m)

    def with_displacement(self, rows: FloatArray, growth: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return the rows (s + g, …) of temperatures with those of displacement sensors put in.

        `growth` returns the growth of the free screw up to places, µm.
        """
        if not self.moved:
            return rows
        out = rows.copy()
        out[list(self.moved)] = restrained_rows(self.moved_restraint, growth(self.moved_m))[: len(self.moved)]
        return out

    @property
    def um_per_K_m(self) -> float:
        """Micrometres of growth per kelvin and metre."""
        return (self.expansion_1_K or 0.0) * UM_PER_M


def modal_rows(modes: Modes, places: Places) -> FloatArray:
    """Rows of the modal amplitudes, (R, N): θ_n(x), then the growth.

    The growth of the free screw is α_T ∫_0^x θ_n dx (Li 2022: E = α_T ∫(T − T_A)), reduced by the supports.
    """
    temperature = places.with_displacement(
        modes.theta(places.temperature_m),
        lambda x_m: places.um_per_K_m * modes.integral(np.zeros_like(x_m), x_m),
    )
    if places.expansion_1_K is None:
        return temperature
    growth = places.um_per_K_m * modes.integral(np.zeros_like(places.growth_m), places.growth_m)
    return np.vstack([temperature, restrained_rows(places.restraint, growth)])


def steady_rows(places: Places, steady: Field, kinks_m: Sequence[float]) -> FloatArray:
    """The output rows (R,) of a steady field, whose slope may have kinks at `kinks_m`."""
    whole = places.with_displacement(
        steady(places.temperature_m),
        lambda x_m: places.um_per_K_m * _running_integral(places.length_m, x_m, steady, kinks_m),
    )
    if places.expansion_1_K is None:
        return whole
    growth = places.um_per_K_m * _running_integral(places.length_m, places.growth_m, steady, kinks_m)
    return np.concatenate([whole, restrained_rows(places.restraint, growth)])


def dropped_under(
    plant: Plant, modes: Modes, full: FullModel, stretch: Stretch
) -> tuple[FloatArray, FloatArray]:
    """Return the mean temperature of the dropped modes on a stretch, as rows (n_x,) of states and (p,) of
    known inputs.
    """
    known, steady, N = plant.known, full.steady, plant.modes
    of_states, of_known = np.zeros(len(plant.decay_1_s)), np.zeros(len(plant.known_names))
    kinks_m = [x for heat in full.heats for _, part in heat.parts for x in part]
    places_m, weights = mean_over(modes.rod, stretch, kinks_m)
    # the part of an input that its modes leave out there
    retained = steady.amplitudes(modes, np.eye(N)).T @ (weights @ modes.theta(places_m))
    for k, heat in enumerate(full.heats):
        under_K_W = sum(part * (weights @ steady.source(s)(places_m)) for part, s in heat.parts)
        of_states[N + k] = under_K_W - retained @ plant.B[:N, k]
    fields: list[tuple[int, Field]] = [(known.ambient, steady.ambient)]
    ends = ((LEFT, known.left_end), (RIGHT, known.right_end))
    fields += [(q, steady.end(side)) for side, q in ends if q is not None]
    for q, field in fields:
        of_known[q] = weights @ field(places_m) - retained @ plant.E[:N, q]
    return of_states, of_known


def reference_rows(places: Places) -> FloatArray:
    """The column (R,) of the thermal error's reference temperature: minus the growth per kelvin of the screw,
    plus that of the bed.
    """
    return _uniform_rows(places, places.bed_1_K * UM_PER_M - places.um_per_K_m)


def bed_rows(places: Places) -> FloatArray:
    """The column (R,) of the bed's temperature.

    Supports and workpiece move with the bed. So its growth is subtracted from that of the free screw, before
    the supports restrain the difference.
    """
    return _uniform_rows(places, -places.bed_1_K * UM_PER_M)


def _uniform_rows(places: Places, um_per_K_m: float) -> FloatArray:
    """The column (R,) of a temperature that expands a body uniformly."""
    temperature = places.with_displacement(np.zeros(len(places.temperature_m)), lambda x_m: um_per_K_m * x_m)
    if places.expansion_1_K is None:
        return temperature
    return np.concatenate([temperature, restrained_rows(places.restraint, um_per_K_m * places.growth_m)])


def _running_integral(
    length_m: float, grid_m: FloatArray, steady: Field, kinks_m: Sequence[float]
) -> FloatArray:
    """∫_0^x of a steady field at each place, by Gauss panels that break at the grid and at its kinks."""
    nodes, weights = quadrature(length_m, [*grid_m.tolist(), *kinks_m])
    running = np.concatenate([[0.0], np.cumsum(steady(nodes) * weights)])
    return np.asarray(running[np.searchsorted(nodes, grid_m)])


class KnownInput(NamedTuple):
    """A measured or configured input: ambient, a prescribed end, the thermal error's reference.

    `modal` (N,) is its input to the modes of the full model, `steady(x)` its steady field per unit.
    """

    name: str
    modal: FloatArray
    steady: Field


class Nut(NamedTuple):
    """A source that moves: the channel of its position, its length and its stroke."""

    channel: str
    length_m: float
    stroke_m: float


@dataclass(frozen=True, slots=True)
class HeatInput:
    """A source of heat.

    Attributes:
        name: Its name.
        stretch: Its footprint, averaged over its motion.
        share: The share of its heat that enters the screw.
        ends: The two footprints at the ends of its stroke.
        ends_fraction: The part of that share which enters over `ends` instead.
        nut: Its motion; None if it is fixed.
        initial_sigma_W: σ of the heat at the start.
        estimated: Whether the heat is estimated.
        random_walk_W2_s: Random walk of its deviation from its law.
        decay_1_s: Decay rate of that deviation.
        law_uncertainty: Relative σ of the law.
        is_by_speed: Whether the law is friction.
        also: Further footprints, each with its heat relative to this one's.
        follows: The source whose heat drives this one, and the ratio of the heats.
    """

    name: str
    stretch: Stretch
    share: float
    ends: tuple[Stretch, ...]
    ends_fraction: float
    nut: Nut | None
    initial_sigma_W: float
    estimated: bool
    random_walk_W2_s: float
    decay_1_s: float
    law_uncertainty: float
    is_by_speed: bool = False
    also: tuple[tuple[float, Stretch], ...] = ()
    follows: tuple[str, float] | None = None

    @property
    def parts(self) -> list[tuple[float, Stretch]]:
        """The stretches over which its heat enters, averaged over its motion, each with its part."""
        own, ends = self.share * (1.0 - self.ends_fraction), self.share * self.ends_fraction / 2
        return [(own, self.stretch), *((ends, stretch) for stretch in self.ends if ends), *self.also]


@dataclass(frozen=True, slots=True)
class FullModel:
    """A screw with many modes, before the reduction.

    Attributes:
        modes: Its modes.
        steady: Its steady fields.
        heats: Its sources of heat.
        known_inputs: Its known inputs.
        places: Places of its output rows.
        sensors: Names of the sensors, (s,).
        noise_K: σ of the sensors, (s,).
        initial_sigma_K: σ of the unknown field at the start.
        field_noise_K_sqrt_s: Noise on the field.
        static_correction: Whether lags replace the dropped modes.
    """

    modes: Modes
    steady: ScrewAtRest
    heats: tuple[HeatInput, ...]
    known_inputs: tuple[KnownInput, ...]
    places: Places
    sensors: tuple[str, ...]
    noise_K: FloatArray
    initial_sigma_K: float
    field_noise_K_sqrt_s: float
    static_correction: bool = True


def reduce(
    full: FullModel, mode_numbers: Sequence[int], nut_places: int = TABLE_POINTS
) -> tuple[Plant, Modes]:
    """Return the plant with the modes `mode_numbers` (from 0) of a full model, and these modes.

    `nut_places` is how many places of a nut its lag's output column is tabulated for.
    """
    modes, heats, places = full.modes.take(list(mode_numbers)), full.heats, full.places
    known_inputs = [k._replace(modal=k.modal[list(mode_numbers)]) for k in full.known_inputs]
    lag_decay_1_s = _first_dropped(full.modes, mode_numbers)
    N, m, rod = len(modes), len(heats), modes.rod
    sigma_W = np.array([h.initial_sigma_W for h in heats])
    footprints = [_footprint(full, modes, h, h.ends_fraction) for h in heats]
    B = np.zeros((N + m, m))
    B[:N] = np.column_stack([b for b, _ in footprints])
    B[N:] = np.diag(np.full(m, lag_decay_1_s))
    C = np.hstack([modal_rows(modes, places), np.column_stack([c for _, c in footprints])])
    E = np.vstack([np.column_stack([k.modal for k in known_inputs]), np.zeros((m, len(known_inputs)))])
    smooth = np.pad(smooth_field_covariance(modes), (0, m))
    past = past_heat_covariance(modes, B[:N], sigma_W)
    # a lag starts at its law, but a machine that was just switched on has not settled there yet
    lags = np.diag(np.concatenate([np.zeros(N), sigma_W**2]))
    free = [h for h in heats if h.estimated]
    plant = Plant(
        layout=Layout(
            sources=tuple(h.name for h in free),
            position_m=places.grid_m,
            sensors=full.sensors,
            has_error=places.expansion_1_K is not None,
            displacements=tuple(full.sensors[i] for i in places.moved),
            has_force=places.expansion_1_K is not None
            and places.restraint is not None
            and places.restraint.holds,
        ),
        decay_1_s=np.concatenate([modes.decay_1_s, np.full(m, lag_decay_1_s)]),
        B=B,
        E=E,
        rows=OutputRows(
            C=C,
            F=_known_rows(full, modes, known_inputs),
            sensors=len(full.sensors),
            grid=len(places.grid_m),
            restraint=places.restraint,
        ),
        moving=_moving_sources(full, modes, lag_decay_1_s, B, nut_places),
        uniform=np.concatenate([_uniform(full, modes, known_inputs), np.zeros(m)]),
        prior_P=full.initial_sigma_K**2 * smooth + np.pad(past, (0, m)) + lags,
        smooth_P=full.initial_sigma_K**2 * smooth,
        noise_R_K2=full.noise_K**2,
        thermal=~np.isin(np.arange(len(places.sensor_m)), places.moved),
        estimated=np.array([h.estimated for h in heats]),
        random_walk_W2_s=np.array([h.random_walk_W2_s for h in free]),
        heat_decay_1_s=np.array([h.decay_1_s for h in free]),
        law_uncertainty=np.array([h.law_uncertainty for h in free]),
        initial_sigma_W=np.array([h.initial_sigma_W for h in free]),
        field_noise_Q=full.field_noise_K_sqrt_s**2 * smooth,
        mode_index=tuple(i + 1 for i in mode_numbers),
        source_names=tuple(h.name for h in heats),
        known_names=tuple(k.name for k in known_inputs),
        diffusion_rate_1_s=rod.diffusivity_m2_s / rod.length_m**2,
        dropped_rate_1_s=lag_decay_1_s,
        coupling=no_coupling(N + m, m, len(known_inputs)),
        following=_following(heats),
        by_speed=tuple(i for i, heat in enumerate(heats) if heat.is_by_speed),
    )
    return plant, modes


def _uniform(full: FullModel, modes: Modes, known_inputs: Sequence[KnownInput]) -> FloatArray:
    """The amplitudes (N,) of a screw at 1 °C in surroundings at 1 °C, as they stay there."""
    if not full.steady.exchanges or modes.rod.floating:
        return modes.stored() / modes.rod.diffusivity_m2_s
    surroundings = [k.modal for k in known_inputs if k.name in (AMBIENT, LEFT, RIGHT)]
    return full.steady.amplitudes(modes, np.sum(surroundings, axis=0))


def _following(heats: Sequence[HeatInput]) -> tuple[Following, ...]:
    """The heats that are parts of others."""
    at = {h.name: i for i, h in enumerate(heats)}
    return tuple(Following(i, at[h.follows[0]], h.follows[1]) for i, h in enumerate(heats) if h.follows)


def _first_dropped(candidates: Modes, mode_numbers: Sequence[int]) -> float:
    """Decay rate of the slowest dropped mode."""
    dropped = sorted(set(range(len(candidates))) - set(mode_numbers))
    return float(candidates.decay_1_s[dropped[0]])


def _footprint(
    full: FullModel, modes: Modes, heat: HeatInput, ends_fraction: float
) -> tuple[FloatArray, FloatArray]:
    """A heat's modal column (N,) and its lag's output column (R,), averaged over its motion."""
    b, c = _own_footprint(full, modes, heat, ends_fraction)
    if not heat.also:
        return b, c
    more_b, more_c = _further_footprints(full, modes, heat)
    return b + more_b, c + more_c


def _further_footprints(full: FullModel, modes: Modes, heat: HeatInput) -> tuple[FloatArray, FloatArray]:
    """The columns (N,) and (R,) of a heat's further footprints."""
    parts = np.array([part for part, _ in heat.also])
    b = np.array([modal_input(modes, stretch) for _, stretch in heat.also])
    c = np.array([_lag_row(full, modes, stretch) for _, stretch in heat.also])
    return parts @ b, parts @ c


def _own_footprint(
    full: FullModel, modes: Modes, heat: HeatInput, ends_fraction: float
) -> tuple[FloatArray, FloatArray]:
    """The columns of `_footprint` without further footprints."""
    b, c = heat.share * modal_input(modes, heat.stretch), heat.share * _lag_row(full, modes, heat.stretch)
    if ends_fraction == 0.0:
        return b, c
    b_ends = [modal_input(modes, s) for s in heat.ends]
    c_ends = [_lag_row(full, modes, s) for s in heat.ends]
    ends_b, ends_c = heat.share * (b_ends[0] + b_ends[1]) / 2, heat.share * (c_ends[0] + c_ends[1]) / 2
    return b + ends_fraction * (ends_b - b), c + ends_fraction * (ends_c - c)


def _lag_row(full: FullModel, modes: Modes, stretch: Stretch) -> FloatArray:
    """Output column (R,) of a heat's lag: its steady field outside the modes of the plant."""
    rows = modal_rows(modes, full.places)
    if not full.static_correction:
        return np.zeros(len(rows))
    return _remainder_of(modes, full.steady, full.places, stretch, rows)


def _remainder_of(
    modes: Modes, steady: ScrewAtRest, places: Places, stretch: Stretch, rows: FloatArray
) -> FloatArray:
    """The part of a steady field outside the modes of the plant, (R,).

    `rows` (R, N) are those of the modes' amplitudes.
    """
    kinks_m = (*stretch, *steady.edges_m)
    amplitudes = steady.amplitudes(modes, modal_input(modes, stretch))
    return np.asarray(steady_rows(places, steady.source(stretch), kinks_m) - rows @ amplitudes)


def _known_rows(full: FullModel, modes: Modes, known_inputs: Sequence[KnownInput]) -> FloatArray:
    """Output columns (R, p) of the known inputs: the dropped modes' share, an offset, a reference."""
    rows, edges_m = modal_rows(modes, full.places), full.steady.edges_m

    def rows_of(k: KnownInput) -> FloatArray:
        if k.name == REFERENCE:
            return reference_rows(full.places)
        if k.name == BED:
            return bed_rows(full.places)
        dropped = steady_rows(full.places, k.steady, edges_m) - rows @ full.steady.amplitudes(modes, k.modal)
        if k.name.startswith(OFFSET):
            dropped[full.sensors.index(k.name.removeprefix(OFFSET))] = 1.0
        return dropped

    return np.column_stack([rows_of(k) for k in known_inputs])


def _moving_sources(
    full: FullModel, modes: Modes, lag_decay_1_s: float, B: FloatArray, nut_places: int
) -> tuple[MovingSource, ...]:
    """Tables of the sources that follow a position channel."""
    sources = []
    for index, heat in enumerate(full.heats):
        if heat.nut is None:
            continue
        cosines = _cosines_of_nut(modes)
        mean_b, mean_C = _own_footprint(full, modes, heat, 0.0)
        if modes.mix is not None:
            mean_b = heat.share * modal_input(cosines, heat.stretch)
        table = NutTable(
            mu_1_m=cosines.mu_1_m,
            phase=cosines.phase,
            scale=heat.share * cosines.scale,
            conductance_W_m=modes.rod.conductance_W_m,
            nut_m=heat.nut.length_m,
            screw_m=modes.rod.length_m,
            stroke_m=heat.nut.stroke_m,
            lag=len(cosines) + index,
            lag_decay_1_s=lag_decay_1_s,
            table_C=heat.share * _nut_rows(full, modes, heat.nut, nut_places),
            mean_B=np.concatenate([mean_b, B[len(modes) :, index]]),
            mean_C=mean_C,
            turn=_mixing(modes, len(cosines), len(B)),
        )
        if heat.also:
            more_b, more_c = _further_footprints(full, modes, heat)
            turn = table.turn if len(table.turn) else np.eye(len(B))
            turn[: len(more_b), table.lag] = more_b / lag_decay_1_s
            table = replace(table, table_C=table.table_C + more_c, mean_C=mean_C + more_c, turn=turn)
        # one alone may stand beyond its stroke, as when a machine is set up; several are in each other's way
        is_only_nut = sum(h.nut is not None for h in full.heats) == 1
        reach_m = None if is_only_nut else (heat.stretch.a_m, heat.stretch.b_m)
        sources.append(MovingSource(index, heat.nut.channel, table, heat.ends_fraction, reach_m))
    return tuple(sources)


def _cosines_of_nut(modes: Modes) -> Modes:
    """The modes themselves or, for a rod with sections, the cosines for a nut's columns.

    The length of the nut smooths shorter waves out.
    """
    if modes.mix is None:
        return modes
    most = min(max(2 * len(modes), LEAST_COSINES), len(modes.mu_1_m))
    i = slice(most)
    return Modes(modes.rod, modes.mu_1_m[i], modes.phase[i], modes.scale[i], modes.mu_1_m[i])


def _mixing(modes: Modes, cosines: int, n_x: int) -> FloatArray:
    """The matrix (n_x, …) from the cosines of a nut's input columns to modes; empty if these are equal."""
    if modes.mix is None:
        return np.zeros((0, 0))
    lags = n_x - len(modes)
    turn = np.zeros((n_x, cosines + lags))
    turn[: len(modes), :cosines] = modes.mix[:cosines].T
    turn[len(modes) :, cosines:] = np.eye(lags)
    return turn


def _nut_rows(full: FullModel, modes: Modes, nut: Nut, nut_places: int) -> FloatArray:
    """The lag's output column of all the heat, with the nut at evenly spaced places, (P, R)."""
    if not full.static_correction:
        return np.zeros((nut_places, len(modal_rows(modes, full.places))))
    exchanges = full.steady.exchanges
    return _remainders_along(modes, exchanges, full.places, nut.length_m, nut_places)


@cached(8)
def _remainders_along(
    modes: Modes, exchanges: tuple[Exchange, ...], places: Places, nut_m: float, nut_places: int
) -> FloatArray:
    """The columns of `_nut_rows` with a static correction."""
    steady = ScrewAtRest(modes.rod, exchanges)
    L, rows = modes.rod.length_m, modal_rows(modes, places)
    stretches = [nut_stretch(x, nut_m, L) for x in np.linspace(0.0, L, nut_places).tolist()]
    return np.array([_remainder_of(modes, steady, places, stretch, rows) for stretch in stretches])
