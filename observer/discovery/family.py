"""Effects that logs cannot distinguish: the family they belong to, and what is known of it, its figure.

The figure follows from the heat that an effect takes out of the screw, by the field that a fit predicts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.discovery.candidates import Candidate
from observer.effects.base import EffectTable, Family
from observer.effects.terms import (
    Body,
    EndConductance,
    Film,
    Heat,
    Radiation,
    SpeedLoss,
    StretchFilm,
    Term,
)
from observer.fit.hypothesis import FORM_SHARE, NORMAL_95, EffectParameter, Fit, with_effects
from observer.fit.problem import Problem
from observer.fit.runs import mean_over
from observer.fit.steps import SteppedRun
from observer.frames import BoolArray, FloatArray
from observer.model.law import heat_law
from observer.physics.constants import ZERO_DEGC_K, STEFAN_BOLTZMANN_W_m2K4
from observer.tables.sections import law_channels


@dataclass(frozen=True, slots=True)
class ScrewHistory:
    """The state of a screw over one run of T steps.

    `position_m` (P,) from end to end, `temperature_degC` (T, P) there, `ambient_degC` (T,), `length_s` (T,)
    of each step, `channels` the mean magnitude (T,) of each channel; `counted` (T,) the steps that were
    fitted.
    """

    position_m: FloatArray
    temperature_degC: FloatArray
    ambient_degC: FloatArray
    length_s: FloatArray
    channels: Mapping[str, FloatArray]
    counted: BoolArray

    @property
    def excess_K(self) -> FloatArray:
        """How much warmer than the air the screw is, (T, P)."""
        return np.asarray(self.temperature_degC - self.ambient_degC[:, None])

    def along(self, values: FloatArray) -> FloatArray:
        """The integral (T,) of values (T, P) over the length."""
        return np.asarray(np.trapezoid(values, self.position_m, axis=1))

    def within(self, values: FloatArray, from_m: float, to_m: float) -> FloatArray:
        """The integral (T,) of values (T, P) over a stretch, linear between the positions."""
        inside = (self.position_m > from_m) & (self.position_m < to_m)
        x = np.concatenate([[from_m], self.position_m[inside], [to_m]])
        edges = [self.at(values, place_m)[:, None] for place_m in (from_m, to_m)]
        return np.asarray(np.trapezoid(np.hstack([edges[0], values[:, inside], edges[1]]), x, axis=1))

    def at(self, values: FloatArray, place_m: float) -> FloatArray:
        """Values (T, P) interpolated at one position, (T,)."""
        i = int(np.clip(np.searchsorted(self.position_m, place_m), 1, len(self.position_m) - 1))
        a, b = self.position_m[i - 1], self.position_m[i]
        share = (place_m - a) / (b - a)
        return np.asarray((1 - share) * values[:, i - 1] + share * values[:, i])


def loss_W(effect: EffectTable, config: Config, history: ScrewHistory) -> FloatArray:
    """Return the heat (T,) that an effect of a configuration takes out of the screw.

    Effects on the heats of other sources, on sensors or on the air itself take none.
    """
    terms = effect.terms(config)
    places = {t.source.name: t.source.position_m for t in terms if isinstance(t, Heat)}
    return np.asarray(
        sum((_of_term(t, config, history, places) for t in terms), np.zeros(len(history.length_s)))
    )


def _of_term(
    term: Term, config: Config, history: ScrewHistory, places: Mapping[str, float | None]
) -> FloatArray:
    """The heat (T,) that one term takes; `places` are the positions of the effect's own sources."""
    taken_W = np.zeros(len(history.length_s))
    match term:
        case Film() | StretchFilm() | SpeedLoss() | Radiation():
            taken_W = np.pi * config.screw.diameter_m * _of_surface(term, history)
        case EndConductance(end, G):
            taken_W = G * history.excess_K[:, 0 if end == "left" else -1]
        case Heat(source):
            law = heat_law(source, config.source, config.screw.length_m)
            read = [history.channels[c] for c in law_channels(source, config.source)]
            taken_W = -law(*(read or [np.zeros(len(history.length_s))]))
        case Body(source, C, G) if (place_m := places.get(source)) is not None:
            taken_W = _into_body(history, history.at(history.temperature_degC, place_m), C, G)
    return taken_W


def _of_surface(term: Film | StretchFilm | SpeedLoss | Radiation, history: ScrewHistory) -> FloatArray:
    """The heat (T,) that a term takes from the surface, along the screw, per m of its circumference."""
    match term:
        case Film(h):
            return h * history.along(history.excess_K)
        case StretchFilm(from_m, to_m, extra):
            return extra * history.within(history.excess_K, from_m, to_m)
        case SpeedLoss(channel, film_W_m2K, temperature_degC):
            drawn_degC = history.ambient_degC if temperature_degC is None else temperature_degC
            above_K = history.temperature_degC - np.reshape(drawn_degC, (-1, 1))
            return film_W_m2K(history.channels[channel]) * history.along(above_K)
        case Radiation(emissivity):
            fourth = (history.temperature_degC + ZERO_DEGC_K) ** 4
            fourth -= ((history.ambient_degC + ZERO_DEGC_K) ** 4)[:, None]
            return emissivity * STEFAN_BOLTZMANN_W_m2K4 * history.along(fourth)


def _into_body(
    history: ScrewHistory, screw_degC: FloatArray, capacity_J_K: float, conductance_W_K: float
) -> FloatArray:
    """The heat (T,) into a body that begins as warm as the screw beside it, C dT_b/dt = G (T − T_b)."""
    kept, body_degC, taken = np.exp(-conductance_W_K / capacity_J_K * history.length_s), screw_degC[0], []
    for screw, share, dt_s in zip(screw_degC, kept, history.length_s, strict=True):
        more_K = (1 - share) * (screw - body_degC)
        taken.append(capacity_J_K * more_K / dt_s if dt_s > 0 else 0.0)
        body_degC += more_K
    return np.array(taken)


PLACES = 41
"""Positions along the screw at which the field is evaluated."""
DIFFERENCE = 1e-3
"""Step of a parameter, in its scale, by which a figure's derivative is taken."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A family's figure as estimated from logs, with its 95 % interval."""

    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Tie:
    """Candidates that explain logs equally well, any of which can replace another.

    A single one is part of every answer and needs no family. `place` is the end that a placed `family` acts
    at; `figure` is the members' mean and spans their intervals.
    """

    members: tuple[Candidate, ...]
    family: Family | None = None
    place: str | None = None
    figure: Figure | None = None


class Member(NamedTuple):
    """A candidate, a fit that holds its effect, and the number of that effect in the fit's configuration."""

    candidate: Candidate
    fit: Fit
    effect: int

    @classmethod
    def of(cls, candidate: Candidate, fit: Fit) -> Member:
        """Find the candidate's effect among those that the fit has added."""
        before, effects = len(fit.problem.config.effect), fit.config.effect
        own = (candidate.kind, candidate.target)
        added = (i for i, e in enumerate(effects) if (e.kind, getattr(e, "target", None)) == own)
        return cls(candidate, fit, next(i for i in added if i >= before))

    @property
    def table(self) -> EffectTable:
        """The effect as fitted."""
        found: EffectTable = self.fit.config.effect[self.effect]
        return found


def ties(sets: Sequence[Sequence[Candidate]], fits: Sequence[Fit]) -> tuple[Tie, ...]:
    """Return what sets of effects have in common, effect by effect; empty unless each exchange stays in a
    family.

    The first set is the best; every other has one effect exchanged.
    """
    if len({len(each) for each in sets}) != 1:
        return ()
    found = []
    for place, own in enumerate(sets[0]):
        exchanged = zip(sets[1:], fits[1:], strict=True)
        others = [Member.of(s[place], fit) for s, fit in exchanged if s[place].name != own.name]
        tie = tie_of([Member.of(own, fits[0]), *others]) if others else Tie((own,))
        if tie is None:
            return ()
        found.append(tie)
    return tuple(sorted(found, key=lambda tie: tie.family is None))


def tie_of(members: Sequence[Member]) -> Tie | None:
    """Return the closest family that all members share, with its figure; None where they share none."""
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

    The interval includes that of the effect's parameters and the uncertainty of its form.
    """
    fit, config = member.fit, member.fit.config
    histories = () if family.against == "own" else histories_of(fit.problem, config)
    own = [(j, p) for j, p in enumerate(fit.parameters) if p.effect == member.effect]

    def at(parameter: EffectParameter | None = None, value: float = 0.0) -> float:
        moved = config if parameter is None else with_effects(config, [parameter], np.array([value]))
        return effective(moved.effect[member.effect], family, moved, histories)

    value, slopes = at(), []
    for j, p in own:
        step = DIFFERENCE * p.scale * (1.0 if fit.values[j] + DIFFERENCE * p.scale <= p.high else -1.0)
        slopes.append((at(p, fit.values[j] + step) - value) / step)
    rows = [len(fit.problem.keys) + j for j, _ in own]
    g, P = np.array(slopes), fit.covariance[np.ix_(rows, rows)]
    wide = NORMAL_95 * float(np.hypot(np.sqrt(max(g @ P @ g, 0.0)), FORM_SHARE * value))
    return Figure(value, (value - wide, value + wide))


def effective(
    effect: EffectTable, family: Family, config: Config, histories: Sequence[ScrewHistory]
) -> float:
    """Return the figure of a family for one of its effects: see `Family`."""
    if family.against == "own":
        return float(getattr(effect, family.key))
    taken_W = np.concatenate([loss_W(effect, config, history)[history.counted] for history in histories])
    if family.against == "time":
        length_s = np.concatenate([history.length_s[history.counted] for history in histories])
        return -float(taken_W @ length_s / length_s.sum())
    end = effect.place(config.screw.length_m)
    driven = np.concatenate([_drive(family, config, history, end)[history.counted] for history in histories])
    return float(taken_W @ driven / (driven @ driven))


def _drive(family: Family, config: Config, history: ScrewHistory, end: str | None) -> FloatArray:
    """What the heat (T,) is regressed on: K, or m² K for a surface."""
    if family.against == "end":
        return np.asarray(history.excess_K[:, 0 if end == "left" else -1])
    mean_K = history.along(history.excess_K) / config.screw.length_m
    surface_m2 = np.pi * config.screw.diameter_m * config.screw.length_m
    return surface_m2 * mean_K if family.against == "surface" else mean_K


def histories_of(problem: Problem, config: Config) -> tuple[ScrewHistory, ...]:
    """Return the state of the screw over each run, as a configuration predicts it."""
    places_m = np.linspace(0.0, config.screw.length_m, PLACES)
    fields = problem.forward.fields(config, places_m)
    return tuple(
        ScrewHistory(places_m, *field, run.ticks.length_s, _sizes(run), _fitted(problem, i, run))
        for i, (run, field) in enumerate(zip(problem.forward.runs, fields, strict=True))
    )


def _sizes(run: SteppedRun) -> dict[str, FloatArray]:
    """The mean magnitude (T,) of each channel over each step."""
    frames, ticks = run.run.frames, run.ticks
    sizes = mean_over(np.nan_to_num(np.abs(frames.values)), frames.dt_s, ticks.first)
    return dict(zip(frames.channels, sizes.T, strict=True))


def _fitted(problem: Problem, number: int, run: SteppedRun) -> BoolArray:
    """Which steps (T,) of a run were fitted."""
    evidence = problem.evidence
    means = np.unique(evidence.mean[evidence.used & (evidence.run == number)])
    return np.asarray(np.isin(run.ticks.mean, means))
