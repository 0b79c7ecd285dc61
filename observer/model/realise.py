"""The first group of an effect's terms: those that change the machine before the plant is built."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from observer.config.effects.terms import Body, EndConductance, Film, Heat, LawScale, SpeedLoss, Term
from observer.config.laws import Surface
from observer.config.machine import Config
from observer.config.quantities import LEAST_END_FILM_W_m2K
from observer.config.sections import Boundary, Source
from observer.model.rod.screw import surface_film_W_m2K, turning_film


class Realised(NamedTuple):
    """A configuration with its effects' films, ends and heats in place.

    Attributes:
        config: The changed configuration.
        terms: The terms that remain: those of inputs and of coupled states.
    """

    config: Config
    terms: tuple[Term, ...]


def realise(config: Config) -> Realised:
    """Return a configuration with those effects applied that change the machine before the plant is built.

    A film law becomes a number, a law's rotation becomes a loss by speed, and linked sources get places on
    the screw.

    Args:
        config: The machine with its effects.

    Raises:
        ConfigError: If an effect is impossible on this machine.
    """
    terms = (*terms_of(config), *_turning(config))
    config = _with(config, surface=_number(config))
    for term in terms:
        if isinstance(term, Film):
            film = config.surface.convection_W_m2K + term.convection_W_m2K
            config = _with(config, surface=config.surface.model_copy(update={"convection_W_m2K": film}))
        elif isinstance(term, EndConductance):
            end = _conducting(
                getattr(config.boundary, term.end), term.conductance_W_K, config.screw.end_area_m2(term.end)
            )
            config = _with(config, boundary=config.boundary.model_copy(update={term.end: end}))
        elif isinstance(term, Heat):
            config = _with(config, source=(*config.source, _with_unique_name(term.source, config)))
        elif isinstance(term, LawScale):
            config = _with(config, source=tuple(_scaled(s, term) for s in config.source))
    config = _with_places(config)
    rest = tuple(t for t in terms if not isinstance(t, Film | EndConductance | Heat | LawScale))
    return Realised(config, (*rest, *_covered_film(config)))


_AIR_J_K, _AIR_1_S = 1e4, 100.0


def _covered_film(config: Config) -> Iterator[Term]:
    """Yield a correction of the base film where nuts cover the screw (Li et al. 2022, eqs. 43 to 47).

    The film is h(x) (1 − m(x)), m the share of the time in which a nut is there. The correction acts as R_Q/m
    with −h P length in place of 1/R_Q, towards a body at the air's temperature: its exchange is that fast.
    """
    screw, film_W_m2K = config.screw, config.surface.convection_W_m2K
    for source in config.source:
        if source.covers_film and film_W_m2K > 0.0:
            low_m, high_m = source.stroke_m or (0.0, screw.length_m)
            per_m = math.pi * screw.mean_diameter_m(low_m, high_m) * film_W_m2K
            conductance_W_K = -per_m * (source.length_m or 0.0)
            place = _at(source, config)
            yield Body(place, _AIR_J_K, conductance_W_K, loss_W_K=_AIR_J_K * _AIR_1_S)


def _at(source: Source, config: Config) -> str:
    """The source that heats the screw at the place of a source: itself, or its place."""
    if source.screw_share > 0.0 and source.shape != "node":
        return source.name
    return next(s.name for s in config.source if s.name.startswith(f"{source.name}.place"))


def _number(config: Config) -> Surface:
    """The surface with the number that its law gives."""
    return Surface(convection_W_m2K=surface_film_W_m2K(config.surface, config.screw.diameter_m))


def _turning(config: Config) -> tuple[Term, ...]:
    """The loss that the surface's law adds as the screw turns, where it follows a channel."""
    channel, film_W_m2K = config.surface.speed_channel, turning_film(config.surface, config.screw.diameter_m)
    return () if channel is None or film_W_m2K is None else (SpeedLoss(channel, film_W_m2K),)


def terms_of(config: Config) -> tuple[Term, ...]:
    """Return the terms of all effects of a configuration, in its order."""
    return tuple(term for effect in config.effect for term in effect.terms(config))


def _with_places(config: Config) -> Config:
    """Give each source that is linked or covers the screw a place if it gives the screw no heat."""
    ends = {end for link in config.link for end in link.between}
    moved = [s for s in config.source if (s.name in ends or s.covers_film) and s.screw_share == 0.0]
    places = {s.name: _with_unique_name(_place(s), config) for s in moved}
    sources = tuple(s.model_copy(update={"shape": "node"}) if s in moved else s for s in config.source)
    links = tuple(
        link.model_copy(update={"between": tuple(places[e].name if e in places else e for e in link.between)})
        for link in config.link
    )
    return _with(config, source=(*sources, *places.values()), link=links)


def _place(source: Source) -> Source:
    """A source at the place of another that delivers 0 W."""
    placement = ("shape", "length_m", "stroke_m", "position_channel", "position_m", "from_m", "to_m")
    return Source(
        name=f"{source.name}.place",
        heat_W=0.0,
        estimate=False,
        initial_sigma_W=1.0,
        **{key: getattr(source, key) for key in placement},
    )


def _with_unique_name(source: Source, config: Config) -> Source:
    """The source with a number after its name where another has the name already."""
    alike = [s.name for s in config.source if s.name == source.name or s.name.startswith(f"{source.name}.")]
    return source.model_copy(update={"name": f"{source.name}.{len(alike) + 1}"}) if alike else source


def _scaled(source: Source, term: LawScale) -> Source:
    """The source with its law scaled, if the term is about it."""
    if source.name != term.source:
        return source
    return source.model_copy(update={"scale": term.factor * source.scale})


def _with(config: Config, **parts: object) -> Config:
    return config.model_copy(update=parts)


def _conducting(end: Boundary, conductance_W_K: float, area_m2: float) -> Boundary:
    """The end with an additional conductance to the ambient; G = h A."""
    film = (end.coefficient_W_m2K or 0.0) + conductance_W_K / area_m2
    return Boundary(kind="convective", coefficient_W_m2K=film) if film >= LEAST_END_FILM_W_m2K else end
