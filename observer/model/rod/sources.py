"""Where each source of the configuration deposits its heat."""

from __future__ import annotations

from collections.abc import Sequence

from observer.model.rod.static import Stretch
from observer.tables.sections import Screw, Source


def mean_stretch(source: Source, screw: Screw) -> Stretch:
    """The stretch over which a source deposits its heat, averaged over its motion; a source that heats nodes
    only stands nowhere, and has the left end for a place.

    A nut's heat is taken as uniform over its stroke (Kim et al., §5), or over the screw where the stroke is
    not given.
    """
    if source.shape in ("point", "node"):
        return Stretch(source.position_m or 0.0, source.position_m or 0.0)
    if source.shape == "band":
        return Stretch(source.from_m or 0.0, source.to_m or 0.0)
    low, high = source.stroke_m or (0.0, screw.length_m)
    return Stretch(low, high)


def nut_stretch(position_m: float, nut_length_m: float, screw_length_m: float) -> Stretch:
    """The stretch under a nut centred at a position, cut at the screw's ends (its heat is not cut)."""
    half = nut_length_m / 2
    centre = min(max(position_m, 0.0), screw_length_m)
    return Stretch(max(centre - half, 0.0), min(centre + half, screw_length_m))


def footprints(sources: Sequence[Source], screw: Screw) -> list[Stretch]:
    """All footprints that the number of modes must serve; the left end where no source is on the screw."""
    found = [s for source in sources for s in design_stretches(source, screw)]
    return found or [Stretch(0.0, 0.0)]


def design_stretches(source: Source, screw: Screw) -> list[Stretch]:
    """The footprints that the modes must serve: a moving nut at both ends and the middle of its stroke."""
    if source.shape == "node":
        return []
    mean = mean_stretch(source, screw)
    if source.shape != "nut" or source.position_channel is None:
        return [mean]
    nut_m = source.length_m or 0.0
    ends = (mean.a_m + nut_m / 2, mean.b_m - nut_m / 2) if source.stroke_m is None else (mean.a_m, mean.b_m)
    places = (ends[0], (mean.a_m + mean.b_m) / 2, ends[1])
    return [mean, *(nut_stretch(x, nut_m, screw.length_m) for x in places)]
