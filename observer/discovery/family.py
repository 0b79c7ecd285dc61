"""Effects that logs cannot distinguish: their family, and the one figure that the logs do determine.

The figure follows from the heat that an effect takes out of the screw, by the field that a fit predicts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.config.effects.base import EffectTable, Family
from observer.config.effects.terms import (
    Body,
    EndConductance,
    Film,
    Heat,
    Radiation,
    RisingFilm,
    SpeedLoss,
    StretchFilm,
)
from observer.config.machine import Config
from observer.config.sections import law_channels
from observer.discovery.candidates import Candidate
from observer.fit.hypothesis import FORM_SHARE, NORMAL_95, EffectParameter, Fit, with_effects
from observer.fit.problem import Problem
from observer.fit.runs import mean_over
from observer.frames import BoolArray, FloatArray
from observer.model.law import heat_law
from observer.physics.constants import STEFAN_BOLTZMANN_W_m2K4
from observer.units import ZERO_DEGC_K

SurfaceTerm = Film | StretchFilm | SpeedLoss | Radiation | RisingFilm


@dataclass(frozen=True, slots=True)
class ScrewHistory:
    """The predicted state of a screw over one run of T steps, at P positions.

    Attributes:
        position_m: Positions from end to end, m, (P,).
        temperature_degC: Temperature of the screw, °C, (T, P).
        ambient_degC: Temperature of the air, °C, (T,).
        length_s: Length of each step, s, (T,).
        channels: Mean magnitude of each channel over the steps, (T,).
        counted: True for the steps that were fitted, (T,).
    """

    position_m: FloatArray
    temperature_degC: FloatArray
    ambient_degC: FloatArray
    length_s: FloatArray
    channels: Mapping[str, FloatArray]
    counted: BoolArray

    @property
    def excess_K(self) -> FloatArray:
        """The temperature of the screw above ambient, (T, P)."""
        return np.asarray(self.temperature_degC - self.ambient_degC[:, None])

    def at(self, x_m: FloatArray | float) -> FloatArray:
        """Return weights that interpolate values along the screw linearly.

        Args:
            x_m: Position or X positions, m.

        Returns:
            Weights (P,) or (P, X), to be multiplied from the right by values (T, P).
        """
        return np.array([np.interp(x_m, self.position_m, unit) for unit in np.eye(len(self.position_m))])

    def over(self, from_m: float, to_m: float) -> FloatArray:
        """Return weights (P,) that integrate values along a stretch, m.

        Args:
            from_m: Beginning of the stretch, m.
            to_m: Its end, m.
        """
        inside = (self.position_m > from_m) & (self.position_m < to_m)
        x_m = np.concatenate([[from_m], self.position_m[inside], [to_m]])
        return np.asarray(np.trapezoid(self.at(x_m), x_m, axis=1))

    @property
    def whole(self) -> FloatArray:
        """Weights that integrate values over the length of the screw, m, (P,)."""
        return self.over(self.position_m[0], self.position_m[-1])


def loss_W(effect: EffectTable, config: Config, history: ScrewHistory) -> FloatArray:
    """Return the heat that an effect of a configuration takes out of the screw, W, (T,).

    Effects on the heats of other sources, on sensors or on the air itself take none.

    Args:
        effect: The effect.
        config: The configuration that contains it.
        history: State of the screw.
    """
    terms, taken_W = effect.terms(config), np.zeros(len(history.length_s))
    diameter_m = config.screw.mean_diameter_m(0.0, config.screw.length_m)
    places = {t.source.name: t.source.position_m for t in terms if isinstance(t, Heat)}
    for term in terms:
        match term:
            case Film() | StretchFilm() | SpeedLoss() | Radiation() | RisingFilm():
                taken_W += np.pi * diameter_m * _of_surface(term, history)
            case EndConductance(end, G):
                taken_W += G * history.excess_K[:, 0 if end == "left" else -1]
            case Heat(source):
                law = heat_law(source, config.source, config.screw.length_m)
                read = [history.channels[c] for c in law_channels(source, config.source)]
                taken_W -= law(*(read or [taken_W * 0.0]))
            case Body(source, C, G) if (place_m := places.get(source)) is not None:
                taken_W += _into_body(history, history.temperature_degC @ history.at(place_m), C, G)
    return taken_W


def _of_surface(term: SurfaceTerm, history: ScrewHistory) -> FloatArray:
    """Return the heat (T,) that a term takes from the surface, along the screw, per m of its
    circumference.
    """
    T_degC, air_degC = history.temperature_degC, history.ambient_degC[:, None]
    match term:
        case Film(h):
            return h * (history.excess_K @ history.whole)
        case StretchFilm(from_m, to_m, extra):
            return extra * (history.excess_K @ history.over(from_m, to_m))
        case SpeedLoss(speed, film_W_m2K, constant_degC, measured):
            known_degC = constant_degC if measured is None else history.channels[measured]
            drawn_degC = air_degC if known_degC is None else np.reshape(known_degC, (-1, 1))
            speed_rpm = 0.0 * history.length_s if speed is None else history.channels[speed]
            return film_W_m2K(speed_rpm) * ((T_degC - drawn_degC) @ history.whole)
        case RisingFilm():
            return np.asarray((term.film_W_m2K(history.excess_K) * history.excess_K) @ history.whole)
        case Radiation(emissivity):
            fourth_K4 = (T_degC + ZERO_DEGC_K) ** 4 - (air_degC + ZERO_DEGC_K) ** 4
            return emissivity * STEFAN_BOLTZMANN_W_m2K4 * (fourth_K4 @ history.whole)


def _into_body(
    history: ScrewHistory, screw_degC: FloatArray, capacity_J_K: float, conductance_W_K: float
) -> FloatArray:
    """Return the heat (T,) into a body that starts at the screw's temperature, C dT_b/dt = G (T − T_b)."""
    decay, body_degC, heats_W = np.exp(-conductance_W_K / capacity_J_K * history.length_s), screw_degC[0], []
    for screw, share, dt_s in zip(screw_degC, decay, history.length_s, strict=True):
        more_K = (1 - share) * (screw - body_degC)
        heats_W.append(capacity_J_K * more_K / dt_s if dt_s > 0 else 0.0)
        body_degC += more_K
    return np.array(heats_W)


PLACES = 41
"""Positions along the screw at which the field is evaluated."""
DIFFERENCE = 1e-3
"""Step of a parameter, in its scale, by which a figure's derivative is taken."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A family's figure, estimated from logs.

    Attributes:
        value: The estimate, in the family's unit.
        ci95: 95 % interval.
    """

    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Tie:
    """Candidates that explain logs equally well, any of which can replace another.

    Attributes:
        members: The candidates. A single one is part of every answer and needs no family.
        family: Their common family, or None.
        place: End at which a placed family acts, or None.
        figure: Mean of the members' figures, with an interval that spans theirs.
    """

    members: tuple[Candidate, ...]
    family: Family | None = None
    place: str | None = None
    figure: Figure | None = None


class Member(NamedTuple):
    """A candidate within a fit.

    Attributes:
        candidate: The candidate.
        fit: A fit that holds its effect.
        effect: Number of that effect in the fit's configuration.
    """

    candidate: Candidate
    fit: Fit
    effect: int

    @classmethod
    def of(cls, candidate: Candidate, fit: Fit) -> Member:
        """Return the candidate with its number among the effects that the fit has added.

        Raises:
            StopIteration: If the fit has not added it.
        """
        before, effects = len(fit.problem.config.effect), fit.config.effect
        identity = (candidate.kind, candidate.target)
        added = (i for i, e in enumerate(effects) if (e.kind, getattr(e, "target", None)) == identity)
        return cls(candidate, fit, next(i for i in added if i >= before))

    @property
    def table(self) -> EffectTable:
        """The effect as fitted."""
        effect: EffectTable = self.fit.config.effect[self.effect]
        return effect


def ties(sets: Sequence[Sequence[Candidate]], fits: Sequence[Fit]) -> tuple[Tie, ...]:
    """Return the common property of sets of effects, effect by effect.

    Args:
        sets: The best set, then sets that differ from it by one effect.
        fits: The fit of each set.

    Returns:
        A tie for each position, those with a family first. Empty if an exchange leaves its family.
    """
    if len({len(effects) for effects in sets}) != 1:
        return ()
    all_ties = []
    for place, candidate in enumerate(sets[0]):
        exchanged = zip(sets[1:], fits[1:], strict=True)
        others = [Member.of(s[place], fit) for s, fit in exchanged if s[place].name != candidate.name]
        tie = tie_of([Member.of(candidate, fits[0]), *others]) if others else Tie((candidate,))
        if tie is None:
            return ()
        all_ties.append(tie)
    return tuple(sorted(all_ties, key=lambda tie: tie.family is None))


def tie_of(members: Sequence[Member]) -> Tie | None:
    """Return the closest family that all members share, with its figure; None if they share none."""
    length_m = members[0].fit.config.screw.length_m
    places = {m.table.place(length_m) for m in members}
    for family in members[0].table.families:
        shared = all(family in m.table.families for m in members)
        if shared and (not family.placed or (len(places) == 1 and places <= {"left", "right"})):
            figures = [figure_of(m, family) for m in members]
            low, high = min(f.ci95[0] for f in figures), max(f.ci95[1] for f in figures)
            return Tie(
                tuple(m.candidate for m in members),
                family,
                places.pop() if family.placed else None,
                Figure(float(np.mean([f.value for f in figures])), (low, high)),
            )
    return None


def figure_of(member: Member, family: Family) -> Figure:
    """Return the family's figure for one member, by the field that its fit predicts.

    The interval includes the uncertainty of the effect's parameters and 1.5 % for the form of the effect.

    Args:
        member: The candidate and its fit.
        family: A family of its effect.
    """
    fit, config = member.fit, member.fit.config
    histories = () if family.against == "own" else histories_of(fit.problem, config)
    numbered = [(j, p) for j, p in enumerate(fit.parameters) if p.effect == member.effect]

    def at(parameter: EffectParameter | None = None, value: float = 0.0) -> float:
        moved = config if parameter is None else with_effects(config, [parameter], np.array([value]))
        return effective(moved.effect[member.effect], family, moved, histories)

    value, slopes = at(), []
    for j, p in numbered:
        step = DIFFERENCE * p.scale * (1.0 if fit.values[j] + DIFFERENCE * p.scale <= p.high else -1.0)
        slopes.append((at(p, fit.values[j] + step) - value) / step)
    rows = [len(fit.problem.keys) + j for j, _ in numbered]
    g, P = np.array(slopes), fit.covariance[np.ix_(rows, rows)]
    half_width = NORMAL_95 * float(np.hypot(np.sqrt(max(g @ P @ g, 0.0)), FORM_SHARE * value))
    return Figure(value, (value - half_width, value + half_width))


def effective(
    effect: EffectTable, family: Family, config: Config, histories: Sequence[ScrewHistory]
) -> float:
    """Return the figure of a family for one of its effects.

    It is the least-squares factor between the heat taken out and the family's regressor, such as the mean
    temperature excess. Against time it is the mean heat that enters.

    Args:
        effect: The effect.
        family: The family, which names the regressor.
        config: The configuration that contains the effect.
        histories: State of the screw in each run; unused if the figure is a key of the effect.
    """
    if family.against == "own":
        return float(getattr(effect, family.key))
    screw, end = config.screw, 0 if effect.place(config.screw.length_m) == "left" else -1
    taken_W, regressor = [], []
    for history in histories:
        mean_K = history.excess_K @ history.whole / screw.length_m
        against = {
            "time": -history.length_s,
            "end": history.excess_K[:, end],
            "surface": screw.surface_m2 * mean_K,
            "screw": mean_K,
        }[family.against]
        taken_W.append(loss_W(effect, config, history)[history.counted])
        regressor.append(against[history.counted])
    q, r = np.concatenate(taken_W), np.concatenate(regressor)
    return float(q @ r / (r @ r if family.against != "time" else -r.sum()))


def histories_of(problem: Problem, config: Config) -> tuple[ScrewHistory, ...]:
    """Return the state of the screw over each run, as a configuration predicts it at 41 positions."""
    places_m = np.linspace(0.0, config.screw.length_m, PLACES)
    fields = problem.forward.fields(config, places_m)
    out, evidence = [], problem.evidence
    for i, (run, field) in enumerate(zip(problem.forward.runs, fields, strict=True)):
        frames, ticks = run.run.frames, run.ticks
        sizes = mean_over(np.nan_to_num(np.abs(frames.values)), frames.dt_s, ticks.first)
        counted = np.isin(ticks.mean, evidence.mean[evidence.used & (evidence.run == i)])
        channels = dict(zip(frames.channels, sizes.T, strict=True))
        out.append(ScrewHistory(places_m, *field, ticks.length_s, channels, counted))
    return tuple(out)
