"""The screw's table: geometry and material, and the sections whose diameter or bore is their own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from observer.config import quantities
from observer.config.quantities import Section
from observer.frames import FloatArray


class ScrewSection(Section):
    """A stretch of the screw with a diameter or bore of its own: a journal, a blind bore."""

    from_m: quantities.Position  #: where it begins
    to_m: quantities.Position  #: where it ends
    diameter_m: quantities.Diameter | None = None  #: its diameter; – is that of the screw
    #: diameter of its bore, 0 where it is solid; – is that of the screw
    bore_m: quantities.Bore | None = None


class Piece(NamedTuple):
    """A stretch of the screw of one diameter and bore.

    Attributes:
        from_m: Its beginning, m.
        to_m: Its end, m.
        diameter_m: Outer diameter, m.
        bore_m: Diameter of its bore, m, 0 where it is solid.
    """

    from_m: float
    to_m: float
    diameter_m: float
    bore_m: float

    @property
    def area_m2(self) -> float:
        """Cross-section π (d² − b²)/4 that conducts, stores and holds, m²."""
        return math.pi * (self.diameter_m**2 - self.bore_m**2) / 4


class Screw(Section):
    """Geometry and material of the screw.

    Sections may not overlap, leave the screw or be empty. Each needs a diameter or bore of its own. A bore as
    large as its diameter is rejected.
    """

    length_m: quantities.ScrewLength  #: length between the bearings; positions count from its left end
    diameter_m: quantities.Diameter  #: effective (root) diameter
    bore_m: quantities.Bore = 0.0  #: diameter of a bore through the whole screw
    conductivity_W_mK: quantities.Conductivity  #: heat conductivity; 45 to 60 for bearing steels
    density_kg_m3: quantities.Density  #: density
    specific_heat_J_kgK: quantities.SpecificHeat  #: specific heat
    #: thermal expansion; with it the thermal error is estimated
    expansion_1_K: quantities.Expansion | None = None
    #: `[[screw.section]]`: [stretches with a diameter or bore of their own](#screwsection)
    section: Annotated[tuple[ScrewSection, ...], Field(max_length=20)] = ()

    @model_validator(mode="after")
    def _some_steel_is_left(self) -> Screw:
        if self.bore_m >= self.diameter_m:
            raise ValueError(
                f"bore_m = {self.bore_m} leaves nothing of diameter_m = {self.diameter_m}; fix one of them"
            )
        return self

    @model_validator(mode="after")
    def _sections_fit(self) -> Screw:
        before_m = 0.0
        for section in sorted(self.section, key=lambda s: s.from_m):
            place = f"section {section.from_m:g} … {section.to_m:g} m"
            if section.diameter_m is None and section.bore_m is None:
                raise ValueError(f"{place} has nothing of its own; give diameter_m or bore_m, or remove it")
            if not section.from_m < section.to_m:
                raise ValueError(f"{place} is empty; the first number must be the smaller")
            if section.to_m > self.length_m:
                raise ValueError(f"{place} leaves the screw, length_m = {self.length_m}; fix one of them")
            if section.from_m < before_m:
                raise ValueError(f"{place} overlaps the one before it, which ends at {before_m:g} m; fix one")
            piece, before_m = self._piece(section), section.to_m
            if piece.bore_m >= piece.diameter_m:
                raise ValueError(
                    f"{place}: bore_m = {piece.bore_m} leaves nothing of diameter_m = {piece.diameter_m}; "
                    "give the section both, or fix one of them"
                )
        return self

    def _piece(self, section: ScrewSection) -> Piece:
        diameter_m = self.diameter_m if section.diameter_m is None else section.diameter_m
        return Piece(
            section.from_m,
            section.to_m,
            diameter_m,
            self.bore_m if section.bore_m is None else section.bore_m,
        )

    def _all_pieces(self) -> Iterator[Piece]:
        """Yield the sections and the stretches between them, from the left."""
        before_m = 0.0
        for section in sorted(self.section, key=lambda s: s.from_m):
            if before_m < section.from_m:
                yield Piece(before_m, section.from_m, self.diameter_m, self.bore_m)
            yield self._piece(section)
            before_m = section.to_m
        if before_m < self.length_m:
            yield Piece(before_m, self.length_m, self.diameter_m, self.bore_m)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The screw from left to right in stretches of one diameter and bore; equal neighbours are joined."""
        alike = itertools.groupby(self._all_pieces(), key=lambda p: p[2:])
        runs = [list(run) for _, run in alike]
        return tuple(run[0]._replace(to_m=run[-1].to_m) for run in runs)

    @property
    def uniform(self) -> bool:
        """Whether diameter and bore are the same from end to end."""
        return all(p[2:] == (self.diameter_m, self.bore_m) for p in self.pieces)

    @property
    def area_m2(self) -> float:
        """Cross-section that conducts, stores and holds outside the sections, m²."""
        return Piece(0.0, self.length_m, self.diameter_m, self.bore_m).area_m2

    def end_area_m2(self, side: str) -> float:
        """Return the cross-section at an end, m².

        Args:
            side: `"left"`, else the right end is taken.
        """
        return self.pieces[0 if side == "left" else -1].area_m2

    @property
    def spring_area_m2(self) -> float:
        """Cross-section of the uniform screw that is as stiff: L/∫dx/A, m²."""
        if self.uniform:
            return self.area_m2
        return self.length_m / sum((p.to_m - p.from_m) / p.area_m2 for p in self.pieces)

    def spring_share(self, places_m: FloatArray) -> FloatArray:
        """Return the part of the screw's compliance that lies before places: ∫₀ˣ dx/A over ∫₀ᴸ dx/A.

        Args:
            places_m: Positions on the screw, m, (g,).

        Returns:
            Shares from 0 to 1, (g,).
        """
        if self.uniform:
            return places_m / self.length_m
        edges_m = np.array([0.0, *(p.to_m for p in self.pieces)])
        each_1_m = [(p.to_m - p.from_m) / p.area_m2 for p in self.pieces]
        before_1_m = np.concatenate([[0.0], np.cumsum(each_1_m)])
        return np.asarray(np.interp(places_m, edges_m, before_1_m / before_1_m[-1]))

    @property
    def capacity_J_K(self) -> float:
        """Heat capacity of the whole screw, sections included, J/K."""
        volume_m3 = sum((p.to_m - p.from_m) * p.area_m2 for p in self.pieces)
        return volume_m3 * self.density_kg_m3 * self.specific_heat_J_kgK

    @property
    def surface_m2(self) -> float:
        """Outer lateral surface, sections included, m²."""
        return math.pi * self.mean_diameter_m(0.0, self.length_m) * self.length_m

    def mean_diameter_m(self, from_m: float, to_m: float) -> float:
        """Return the mean outer diameter over a stretch, m.

        Args:
            from_m: Beginning of the stretch, m.
            to_m: Its end, m, beyond `from_m`.
        """
        if self.uniform:
            return self.diameter_m
        shares = [max(min(p.to_m, to_m) - max(p.from_m, from_m), 0.0) for p in self.pieces]
        return sum(w * p.diameter_m for w, p in zip(shares, self.pieces, strict=True)) / sum(shares)
