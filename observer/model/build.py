"""Build the plant of a configuration: the full model, its reduction, and the bodies beside the screw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from observer.config.effects.terms import COUPLING_TERMS, LawFactor, SensorOffset, StrokeEnds, Term
from observer.config.laws import SPEED_LAWS
from observer.config.machine import Config
from observer.config.sections import Description, Source, following, part_of_heat
from observer.errors import ConfigError
from observer.frames import FloatArray
from observer.model.bending import CANDIDATES, with_bending
from observer.model.couple import with_coupling
from observer.model.extend import with_learning, with_shown_part
from observer.model.generator import diagonalised, generator
from observer.model.network import attached, exchanges_of
from observer.model.plant import AMBIENT, BED, LEFT, OFFSET, REFERENCE, RIGHT, Plant
from observer.model.realise import realise
from observer.model.reduce import FullModel, HeatInput, KnownInput, Nut, Places, reduce
from observer.model.rod.modes import (
    Modes,
    end_field,
    footprints,
    held_s,
    keep_by_ratio,
    keep_by_tail,
    mean_stretch,
    nut_stretch,
    solve_modes,
)
from observer.model.rod.moving import TABLE_POINTS
from observer.model.rod.screw import rod_of
from observer.model.rod.supports import Restraint, restraint_of
from observer.model.rough_network import with_rough_network
from observer.model.steady import ScrewAtRest, with_closed_form

MOST_MODES = 400
MOST_ASKED = 150
"""Maximum number of modes of a criterion: a step costs their square, a design their cube."""
DEFAULT_GRID_POINTS = 21


def build_plant(config: Config, *, nut_places: int = TABLE_POINTS, learns: bool = False) -> Plant:
    """Return the plant of a configuration with its effects. Raises `ConfigError` if an effect is impossible.

    `nut_places` is how many places of a nut its lag's output column is tabulated for. With `learns`, the
    plant includes the parameters that its estimator learns or considers.
    """
    machine = realise(config)
    full = full_model(machine.config, machine.terms)
    cosines = keep_modes(machine.config, full.modes)
    full, mode_numbers, bent = with_bending(full, cosines)
    plant, modes = reduce(full, mode_numbers, nut_places)
    if bent:
        numbers = [*cosines, *range(max(cosines) + 1, max(cosines) + 1 + bent)]
        plant = replace(plant, bent=bent, mode_index=tuple(n + 1 for n in numbers))
    constant = None
    if machine.config.node or any(isinstance(t, COUPLING_TERMS) for t in machine.terms):
        plant, constant = with_coupling(plant, modes, full, machine.config, machine.terms)
    else:
        plant = with_shown_part(plant, machine.config.sensor)
    if learns and constant is not None:
        plant = with_rough_network(plant, machine.config, config.link, machine.terms, constant, full, modes)
    elif learns:
        plant = with_learning(plant, machine.config, full, modes)
    return plant if constant is None else diagonalised(plant, constant)


def full_model(config: Config, terms: Sequence[Term]) -> FullModel:
    """Return the full model of a configuration with its effects, without the couplings of its states."""
    exchanges = exchanges_of(config, attached(config, terms))
    most = config.model.modes or MOST_MODES
    modes = solve_modes(rod_of(config), (max(most, CANDIDATES) if exchanges else most) + 1)
    steady = ScrewAtRest(modes.rod, with_closed_form(modes.rod, exchanges))
    refuse_on_followed(config, terms)
    ends = {t.source: t.fraction for t in terms if isinstance(t, StrokeEnds)}
    return FullModel(
        modes=modes,
        steady=steady,
        heats=tuple(_heat(config, s, ends.get(s.name, 0.0)) for s in config.source),
        known_inputs=_known_inputs(modes, steady, config, terms),
        places=_places(config),
        sensors=tuple(s.name for s in config.sensor),
        noise_K=np.array([s.noise for s in config.sensor]),
        initial_sigma_K=config.estimator.initial_sigma_K,
        field_noise_K_sqrt_s=config.estimator.field_noise_K_sqrt_s,
        static_correction=config.model.static_correction,
    )


def _heat(config: Config, source: Source, ends_fraction: float) -> HeatInput:
    L, nut = config.screw.length_m, None
    low_m, high_m = source.stroke_m or (0.0, L)
    if source.shape == "nut" and source.position_channel is not None:
        nut = Nut(source.position_channel, source.length_m or 0.0, high_m - low_m)
    also = following(config.source).get(source.name, ())
    return HeatInput(
        name=source.name,
        stretch=mean_stretch(source, config.screw),
        share=0.0 if source.follows else source.screw_share,
        ends=tuple(nut_stretch(x, source.length_m or 0.0, L) for x in (low_m, high_m)),
        ends_fraction=ends_fraction,
        nut=nut,
        initial_sigma_W=source.initial_sigma_W,
        estimated=source.estimate and not source.follows,
        random_walk_W2_s=source.random_walk_W_sqrt_s**2,
        decay_1_s=1 / source.time_constant_s if source.time_constant_s else 0.0,
        law_uncertainty=config.law_uncertainty(source),
        is_by_speed=source.law in SPEED_LAWS,
        also=tuple((part, mean_stretch(other, config.screw)) for part, other in also),
        follows=(source.own_or_followed, part_of_heat(source)) if source.follows else None,
    )


def refuse_on_followed(machine: Description, terms: Sequence[Term]) -> None:
    """Raise `ConfigError` if an effect acts on one of several sources that share one heat."""
    owners = following(machine.source)
    followers = {s.name for s in machine.source if s.follows}
    for term in terms:
        name = getattr(term, "source", None)
        if not isinstance(name, str):
            continue
        if name in followers or (name in owners and not isinstance(term, LawFactor | StrokeEnds)):
            raise ConfigError(
                f"source {name}: an effect acts on it alone, but its heat is one with that of others; remove "
                "follows, or the effect"
            )


def keep_modes(config: Config, candidates: Modes) -> list[int]:
    """Return the numbers (from 0) of the modes that the configuration keeps: enough for every source's
    footprint.

    With the tail criterion, the first dropped mode also settles within `settle_s`. Raises `ConfigError` if a
    stated criterion needs more than `MOST_ASKED` modes. A default is met as far as that many modes reach.
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
    for key, required, remedy in (
        ("settle_s", by_time, f"give at least {math.ceil(100 * reached_s) / 100:g} s"),
        ("truncation", by_tail, "give 0.9995, which the static correction makes exact at rest"),
    ):
        if required > MOST_ASKED and key in settings.model_fields_set:
            stated = getattr(settings, key)
            raise ConfigError(
                f"model.{key} = {stated:.12g} asks for {required} modes or more, and {MOST_ASKED} are the "
                f"most; {remedy}"
            )
    return list(range(min(max(by_tail, by_time, 1), MOST_ASKED)))


def grid_of(config: Config) -> FloatArray:
    """Positions in m at which the field is reported."""
    if config.output.positions_m is not None:
        return np.array(config.output.positions_m)
    return np.linspace(0.0, config.screw.length_m, DEFAULT_GRID_POINTS)


def _places(config: Config) -> Places:
    screw, grid_m = config.screw, grid_of(config)
    # one beside the screw gets its row with the node it sits on
    sensor_m = np.array([s.position_m or 0.0 for s in config.sensor])
    bed_1_K = 0.0 if config.bed is None else config.bed.expansion_1_K
    moved = tuple(i for i, s in enumerate(config.sensor) if s.kind == "displacement")
    restraint, sensor_restraint = (restraint_on(config, x_m) for x_m in (grid_m, sensor_m[list(moved)]))
    return Places(
        sensor_m, grid_m, screw.expansion_1_K, screw.length_m, restraint, bed_1_K, moved, sensor_restraint
    )


def restraint_on(config: Config, places_m: FloatArray) -> Restraint | None:
    """Return the restraint of a configuration's supports at places (g,); None without supports."""
    return None if config.supports is None else restraint_of(config.supports, config.screw, places_m)


def _known_inputs(
    modes: Modes, steady: ScrewAtRest, config: Config, terms: Sequence[Term]
) -> tuple[KnownInput, ...]:
    """Ambient, prescribed ends, sensors' offsets, a measured bed, and the reference of the thermal error.

    The temperature itself is expanded in modes, so an end's temperature enters through the slope of the
    modes there (Green's identity) and no derivative of a measured temperature is needed.
    """
    rod = modes.rod
    film = rod.fin_1_m**2 * modes.wetted(0.0, rod.length_m)
    for end, x_m in ((rod.left, 0.0), (rod.right, rod.length_m)):
        if not end.prescribed:
            film = film + end.biot_1_m * modes.theta(x_m)[0]
    inputs = [KnownInput(AMBIENT, film, steady.ambient)]
    for end, name, x_m, inward in ((rod.left, LEFT, 0.0, 1.0), (rod.right, RIGHT, rod.length_m, -1.0)):
        if end.prescribed:
            # at an end a sum of cosines has a slope that converges slowly
            alone = partial(end_field, rod, name)
            into = inward * modes.slope(x_m) if rod.profile is None else modes.settling(alone)
            inputs.append(KnownInput(name, into, steady.end(name)))
    offset = dict.fromkeys(t.sensor for t in terms if isinstance(t, SensorOffset))
    inputs += [KnownInput(OFFSET + name, np.zeros(len(modes)), np.zeros_like) for name in offset]
    if config.bed is not None and config.bed.channel is not None:
        inputs.append(KnownInput(BED, np.zeros(len(modes)), np.zeros_like))
    inputs.append(KnownInput(REFERENCE, np.zeros(len(modes)), np.zeros_like))
    return tuple(inputs)


REFERENCE_MODES = 400


def with_many_modes(config: Config) -> Plant:
    """Return the plant of a configuration with `REFERENCE_MODES` modes."""
    model = config.model.model_copy(update={"modes": REFERENCE_MODES, "static_correction": True})
    return build_plant(config.model_copy(update={"model": model}))


def transient_error_K_W(config: Config, plant: Plant, times_s: tuple[float, ...]) -> FloatArray:
    """Return the largest field error per W of a heat step at each time after it, over sources, (t,), K/W.

    The reference is the same screw with 400 modes. Nuts are spread over their strokes. Losses that vary with
    time are left out.
    """
    reference = with_many_modes(config)
    reduced_K_W, reference_K_W = (_step_responses(p, times_s) for p in (plant, reference))
    return np.array(np.abs(reduced_K_W - reference_K_W).max(axis=(1, 2)))


def _step_responses(plant: Plant, times_s: tuple[float, ...]) -> FloatArray:
    """The field (t, g, m) after heat steps of 1 W at each time after them, K/W."""
    C, decay_1_s, B = plant.rows.C[plant.rows.field_slice], plant.decay_1_s, plant.B
    if len(plant.coupling.links.source):
        rates_1_s, V = np.linalg.eig(generator(plant))
        C, decay_1_s, B = C @ V.real, -rates_1_s.real, np.linalg.solve(V.real, B)
    return np.array([C @ (held_s(decay_1_s, time_s)[:, None] * B) for time_s in times_s])
