"""From a configuration to the plant: the one place where modes, sources, ends and outputs meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.effects.terms import COUPLING_TERMS, Offset, StrokeEnds, Term
from observer.errors import ConfigError
from observer.frames import FloatArray, Layout
from observer.model.couple import with_coupling
from observer.model.coupling import no_coupling
from observer.model.learn import with_learning
from observer.model.plant import AMBIENT, LEFT, OFFSET, REFERENCE, RIGHT, MovingSource, Plant, Rows
from observer.model.prior import past_heat_covariance, smooth_field_covariance
from observer.model.realise import realise
from observer.model.rod.modes import Modes, solve_modes
from observer.model.rod.moving import TABLE_POINTS, NutTable
from observer.model.rod.rows import Places, modal_rows, reference_rows, remainder_rows
from observer.model.rod.screw import rod_of
from observer.model.rod.sources import footprints, mean_stretch, nut_stretch
from observer.model.rod.static import Stretch, ambient_field, end_field, source_field
from observer.model.rod.supports import restraint_of
from observer.model.rod.truncation import contributions, keep_by_ratio, keep_by_tail, modal_input
from observer.tables.sections import Source

MOST_MODES = 400
MOST_ASKED = 150
"""The most modes that a criterion may ask for: a step costs their square, a design their cube."""
DEFAULT_GRID_POINTS = 21


class KnownInput(NamedTuple):
    """An input that is measured or configured: ambient, a prescribed end, the thermal error's reference.

    `modal` (N,) is its input to the modes, `steady(x)` its steady field per unit.
    """

    name: str
    modal: FloatArray
    steady: Callable[[FloatArray], FloatArray]


def build_plant(config: Config, *, nut_places: int = TABLE_POINTS, learns: bool = False) -> Plant:
    """Return the plant of a configuration with its effects. Raises `ConfigError` where one cannot stand.

    `nut_places` is how many places of a nut its lag's output column is tabulated for. With `learns` the plant
    has what its estimator learns or allows for, too.
    """
    machine = realise(config)
    plant, modes = _plain_plant(machine.config, machine.terms, nut_places)
    if machine.config.node or any(isinstance(t, COUPLING_TERMS) for t in machine.terms):
        sigma_W = np.array([s.initial_sigma_W for s in machine.config.source])
        plant = with_coupling(plant, modes, machine.config, machine.terms, sigma_W)
    return with_learning(plant, machine.config, modes) if learns else plant


def _plain_plant(config: Config, terms: Sequence[Term], nut_places: int) -> tuple[Plant, Modes]:
    """The plant without what couples its states, and its modes."""
    rod = rod_of(config)
    candidates = solve_modes(rod, (config.model.modes or MOST_MODES) + 1)
    kept = keep_modes(config, candidates)
    modes = candidates.take(kept)
    lag_decay_1_s = _first_dropped(candidates, kept)
    places = _places(config)
    known = _known_inputs(modes, terms)

    N, m = len(modes), len(config.source)
    ends = {t.source: t.fraction for t in terms if isinstance(t, StrokeEnds)}
    footprints = [_footprint(config, modes, places, s, ends.get(s.name, 0.0)) for s in config.source]
    B = np.zeros((N + m, m))
    B[:N] = np.column_stack([b for b, _ in footprints])
    B[N:] = np.diag(np.full(m, lag_decay_1_s))
    C = np.hstack([modal_rows(modes, places), np.column_stack([c for _, c in footprints])])
    E = np.vstack([np.column_stack([k.modal for k in known]), np.zeros((m, len(known)))])
    smooth = np.pad(smooth_field_covariance(modes), (0, m))
    past = past_heat_covariance(modes, B[:N], np.array([s.initial_sigma_W for s in config.source]))
    # a lag starts at its law, but a machine that was just switched on has not settled there yet
    lags = np.diag(np.concatenate([np.zeros(N), [s.initial_sigma_W**2 for s in config.source]]))
    free = [s for s in config.source if s.estimate]
    plant = Plant(
        layout=_layout(config, places),
        decay_1_s=np.concatenate([modes.decay_1_s, np.full(m, lag_decay_1_s)]),
        B=B,
        E=E,
        rows=Rows(
            C=C,
            F=_known_rows(config, modes, places, known),
            sensors=len(config.sensor),
            grid=len(places.grid_m),
            restraint=places.restraint,
        ),
        moving=_moving_sources(config, modes, places, lag_decay_1_s, B, ends, nut_places),
        uniform=np.concatenate([modes.integral(0.0, rod.length_m)[0] / rod.diffusivity_m2_s, np.zeros(m)]),
        prior_P=config.estimator.initial_sigma_K**2 * smooth + np.pad(past, (0, m)) + lags,
        smooth_P=config.estimator.initial_sigma_K**2 * smooth,
        noise_R_K2=np.array([s.noise_K**2 for s in config.sensor]),
        estimated=np.array([s.estimate for s in config.source]),
        random_walk_W2_s=np.array([s.random_walk_W_sqrt_s**2 for s in free]),
        heat_decay_1_s=np.array([1 / s.time_constant_s if s.time_constant_s else 0.0 for s in free]),
        law_uncertainty=np.array([s.law_uncertainty for s in free]),
        initial_sigma_W=np.array([s.initial_sigma_W for s in free]),
        field_noise_Q=config.estimator.field_noise_K_sqrt_s**2 * smooth,
        mode_index=tuple(i + 1 for i in kept),
        source_names=tuple(s.name for s in config.source),
        known_names=tuple(k.name for k in known),
        diffusion_rate_1_s=rod.diffusivity_m2_s / rod.length_m**2,
        coupling=no_coupling(N + m, m, len(known)),
    )
    return plant, modes


def keep_modes(config: Config, candidates: Modes) -> list[int]:
    """Which modes (from 0) the configuration keeps: enough for every source's footprint.

    With the tail criterion, also enough that the first dropped mode settles within `settle_s`. What is stated
    and asks for more than `MOST_ASKED` is refused (`ConfigError`); a default is met as far as they reach.
    """
    settings = config.model
    if settings.modes is not None:
        return list(range(settings.modes))
    stretches = footprints(config.source, config.screw)
    if settings.criterion == "kim":
        return sorted(set().union(*(keep_by_ratio(candidates, s, settings.truncation) for s in stretches)))
    by_tail = max(len(keep_by_tail(candidates, s, settings.truncation)) for s in stretches)
    settled = np.flatnonzero(candidates.decay_1_s * settings.settle_s >= 1.0)
    by_time = int(settled[0]) if len(settled) else MOST_MODES
    reached_s = 1.0 / float(candidates.decay_1_s[MOST_ASKED])
    for key, asked, remedy in (
        ("settle_s", by_time, f"give at least {math.ceil(100 * reached_s) / 100:g} s"),
        ("truncation", by_tail, "give 0.9995, which the static correction makes exact at rest"),
    ):
        if asked > MOST_ASKED and key in settings.model_fields_set:
            stated = getattr(settings, key)
            raise ConfigError(
                f"model.{key} = {stated:.12g} asks for {asked} modes or more, and {MOST_ASKED} are the most; "
                f"{remedy}"
            )
    return list(range(min(max(by_tail, by_time, 1), MOST_ASKED)))


def grid_of(config: Config) -> FloatArray:
    """Positions in m at which the field is reported."""
    if config.output.positions_m is not None:
        return np.array(config.output.positions_m)
    return np.linspace(0.0, config.screw.length_m, DEFAULT_GRID_POINTS)


def _places(config: Config) -> Places:
    screw, grid_m = config.screw, grid_of(config)
    held = config.supports
    restraint = None if held is None else restraint_of(held, screw.length_m, screw.diameter_m, grid_m)
    # one beside the screw gets its row with the node it sits on
    sensor_m = np.array([s.position_m or 0.0 for s in config.sensor])
    return Places(sensor_m, grid_m, screw.expansion_1_K, screw.length_m, restraint)


def _layout(config: Config, places: Places) -> Layout:
    return Layout(
        sources=tuple(s.name for s in config.source if s.estimate),
        position_m=places.grid_m,
        sensors=tuple(s.name for s in config.sensor),
        has_error=places.expansion_1_K is not None,
    )


def _first_dropped(candidates: Modes, kept: list[int]) -> float:
    """Decay rate of the slowest dropped mode."""
    dropped = sorted(set(range(len(candidates))) - set(kept))
    return float(candidates.decay_1_s[dropped[0]])


def _footprint(
    config: Config, modes: Modes, places: Places, source: Source, ends_fraction: float
) -> tuple[FloatArray, FloatArray]:
    """A source's modal column (N,) and its lag's output column (R,), averaged over its motion."""
    stretch = mean_stretch(source, config.screw)
    share = source.screw_share
    b, c = share * modal_input(modes, stretch), share * _lag_row(config, modes, places, stretch)
    if ends_fraction == 0.0:
        return b, c
    ends_b, ends_c = _at_stroke_ends(config, modes, places, source)
    return b + ends_fraction * (ends_b - b), c + ends_fraction * (ends_c - c)


def _at_stroke_ends(
    config: Config, modes: Modes, places: Places, source: Source
) -> tuple[FloatArray, FloatArray]:
    """The columns (N,), (R,) of a nut that stands at both ends of its stroke for equal times."""
    L = config.screw.length_m
    stretches = [nut_stretch(x, source.length_m or 0.0, L) for x in source.stroke_m or (0.0, L)]
    b = [modal_input(modes, s) for s in stretches]
    c = [_lag_row(config, modes, places, s) for s in stretches]
    return source.screw_share * (b[0] + b[1]) / 2, source.screw_share * (c[0] + c[1]) / 2


def _lag_row(
    config: Config, modes: Modes, places: Places, stretch: Stretch, rows: FloatArray | None = None
) -> FloatArray:
    """Output column (R,) of a source's lag: what the kept modes leave of its steady field."""
    if not config.model.static_correction:
        return np.zeros(len(modal_rows(modes, places)))
    steady = partial(source_field, modes.rod, stretch)
    return remainder_rows(modes, places, steady, contributions(modes, stretch), stretch, rows)


def _known_inputs(modes: Modes, terms: Sequence[Term]) -> list[KnownInput]:
    """Ambient, prescribed ends, sensors' offsets and the reference of the thermal error.

    The temperature itself is expanded in modes, so an end's temperature enters through the slope of the
    modes there (Green's identity) and no derivative of a measured temperature is needed.
    """
    rod = modes.rod
    film = rod.fin_1_m**2 * modes.integral(0.0, rod.length_m)[0]
    for end, x_m in ((rod.left, 0.0), (rod.right, rod.length_m)):
        if not end.prescribed:
            film = film + end.biot_1_m * modes.theta(x_m)[0]
    known = [KnownInput(AMBIENT, film, partial(ambient_field, rod))]
    if rod.left.prescribed:
        known.append(KnownInput(LEFT, modes.slope(0.0), partial(end_field, rod, LEFT)))
    if rod.right.prescribed:
        known.append(KnownInput(RIGHT, -modes.slope(rod.length_m), partial(end_field, rod, RIGHT)))
    offset = dict.fromkeys(t.sensor for t in terms if isinstance(t, Offset))
    known += [KnownInput(OFFSET + name, np.zeros(len(modes)), np.zeros_like) for name in offset]
    known.append(KnownInput(REFERENCE, np.zeros(len(modes)), np.zeros_like))
    return known


def _known_rows(config: Config, modes: Modes, places: Places, known: list[KnownInput]) -> FloatArray:
    """Output columns (R, p) of the known inputs: the dropped modes' share, an offset, a reference."""
    safe = np.where(modes.decay_1_s > 0, modes.decay_1_s, math.inf)
    sensors = [s.name for s in config.sensor]

    def rows_of(k: KnownInput) -> FloatArray:
        if k.name == REFERENCE:
            return reference_rows(places)
        rows = remainder_rows(modes, places, k.steady, k.modal / safe)
        if k.name.startswith(OFFSET):
            rows[sensors.index(k.name.removeprefix(OFFSET))] = 1.0
        return rows

    return np.column_stack([rows_of(k) for k in known])


def _moving_sources(
    config: Config,
    modes: Modes,
    places: Places,
    lag_decay_1_s: float,
    B: FloatArray,
    ends: Mapping[str, float],
    nut_places: int,
) -> tuple[MovingSource, ...]:
    """Tables of the sources that follow a position channel."""
    found = []
    for index, source in enumerate(config.source):
        if source.shape != "nut" or source.position_channel is None:
            continue
        low_m, high_m = source.stroke_m or (0.0, modes.rod.length_m)
        mean_B = B[:, index].copy()
        mean_B[: len(modes)], mean_C = _footprint(config, modes, places, source, 0.0)
        table = NutTable(
            mu_1_m=modes.mu_1_m,
            phase=modes.phase,
            scale=source.screw_share * modes.scale,
            conductance_W_m=modes.rod.conductance_W_m,
            nut_m=source.length_m or 0.0,
            screw_m=modes.rod.length_m,
            stroke_m=high_m - low_m,
            lag=len(modes) + index,
            lag_decay_1_s=lag_decay_1_s,
            table_C=_nut_rows(config, modes, places, source, nut_places),
            mean_B=mean_B,
            mean_C=mean_C,
        )
        fraction = ends.get(source.name, 0.0)
        found.append(MovingSource(index, source.position_channel, table, fraction))
    return tuple(found)


def _nut_rows(config: Config, modes: Modes, places: Places, source: Source, nut_places: int) -> FloatArray:
    """The lag's output column with the nut at evenly spaced places, (P, R)."""
    L, nut_m = modes.rod.length_m, source.length_m or 0.0
    stretches = [nut_stretch(x, nut_m, L) for x in np.linspace(0.0, L, nut_places).tolist()]
    rows = modal_rows(modes, places)
    return source.screw_share * np.array([_lag_row(config, modes, places, s, rows) for s in stretches])
