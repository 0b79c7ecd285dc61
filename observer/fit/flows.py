"""The heat that an effect takes out of a screw, from the field that a fit predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.config import Config
from observer.effects.base import EffectTable
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
from observer.frames import BoolArray, FloatArray
from observer.model.law import heat_law
from observer.physics.constants import ZERO_DEGC_K, STEFAN_BOLTZMANN_W_m2K4
from observer.tables.sections import law_channels


@dataclass(frozen=True, slots=True)
class Past:
    """What a screw went through in one run, in T steps.

    `position_m` (P,) from end to end, `temperature_degC` (T, P) there, `ambient_degC` (T,), `length_s` (T,)
    of each step, `channels` the mean size (T,) of what each tells; `counted` (T,) the steps that were fitted.
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
        """The integral (T,) of values (T, P) over a stretch, straight between the places."""
        inside = (self.position_m > from_m) & (self.position_m < to_m)
        x = np.concatenate([[from_m], self.position_m[inside], [to_m]])
        edges = [self.at(values, place_m)[:, None] for place_m in (from_m, to_m)]
        return np.asarray(np.trapezoid(np.hstack([edges[0], values[:, inside], edges[1]]), x, axis=1))

    def at(self, values: FloatArray, place_m: float) -> FloatArray:
        """Values (T, P) at one place, (T,)."""
        i = int(np.clip(np.searchsorted(self.position_m, place_m), 1, len(self.position_m) - 1))
        a, b = self.position_m[i - 1], self.position_m[i]
        share = (place_m - a) / (b - a)
        return np.asarray((1 - share) * values[:, i - 1] + share * values[:, i])


def loss_W(effect: EffectTable, config: Config, past: Past) -> FloatArray:
    """Return the heat (T,) that an effect of a configuration takes out of the screw.

    What acts on the heats of other sources, on sensors or on the air itself takes none.
    """
    terms = effect.terms(config)
    places = {t.source.name: t.source.position_m for t in terms if isinstance(t, Heat)}
    return np.asarray(sum((_of_term(t, config, past, places) for t in terms), np.zeros(len(past.length_s))))


def _of_term(term: Term, config: Config, past: Past, places: Mapping[str, float | None]) -> FloatArray:
    """The heat (T,) that one term takes; `places` are where the effect's own sources stand."""
    taken_W = np.zeros(len(past.length_s))
    match term:
        case Film() | StretchFilm() | SpeedLoss() | Radiation():
            taken_W = np.pi * config.screw.diameter_m * _of_surface(term, past)
        case EndConductance(end, G):
            taken_W = G * past.excess_K[:, 0 if end == "left" else -1]
        case Heat(source):
            law = heat_law(source, config.source, config.screw.length_m)
            read = [past.channels[c] for c in law_channels(source, config.source)]
            taken_W = -law(*(read or [np.zeros(len(past.length_s))]))
        case Body(source, C, G) if (place_m := places.get(source)) is not None:
            taken_W = _into_body(past, past.at(past.temperature_degC, place_m), C, G)
    return taken_W


def _of_surface(term: Film | StretchFilm | SpeedLoss | Radiation, past: Past) -> FloatArray:
    """The heat (T,) that a term takes from the surface, along the screw, per m of its girth."""
    match term:
        case Film(h):
            return h * past.along(past.excess_K)
        case StretchFilm(from_m, to_m, extra):
            return extra * past.within(past.excess_K, from_m, to_m)
        case SpeedLoss(channel, film_W_m2K, temperature_degC):
            drawn_degC = past.ambient_degC if temperature_degC is None else temperature_degC
            above_K = past.temperature_degC - np.reshape(drawn_degC, (-1, 1))
            return film_W_m2K(past.channels[channel]) * past.along(above_K)
        case Radiation(emissivity):
            fourth = (past.temperature_degC + ZERO_DEGC_K) ** 4
            fourth -= ((past.ambient_degC + ZERO_DEGC_K) ** 4)[:, None]
            return emissivity * STEFAN_BOLTZMANN_W_m2K4 * past.along(fourth)


def _into_body(past: Past, screw_degC: FloatArray, capacity_J_K: float, conductance_W_K: float) -> FloatArray:
    """The heat (T,) into a body that begins as warm as the screw beside it, C dT_b/dt = G (T − T_b)."""
    kept, body_degC, taken = np.exp(-conductance_W_K / capacity_J_K * past.length_s), screw_degC[0], []
    for screw, share, dt_s in zip(screw_degC, kept, past.length_s, strict=True):
        more_K = (1 - share) * (screw - body_degC)
        taken.append(capacity_J_K * more_K / dt_s if dt_s > 0 else 0.0)
        body_degC += more_K
    return np.array(taken)
