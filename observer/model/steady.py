"""The steady fields of a screw whose nuts exchange heat with nodes, in closed form.

Under a nut that sweeps over its stroke, each place exchanges separately (Li 2022, eq. 45). The link of nut
and node passes the heat of the mean temperature. Beyond that, the screw loses

    G/w (T − T̄),    T̄ = ∫ T dx/w over the stroke of width w.

The first term is that of a film along the stroke, which has closed forms. The second is of rank one for each
nut (Woodbury 1950): the field of a rod with films, plus those of the heats G T̄ over the strokes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import numpy as np

from observer.frames import FloatArray
from observer.model.caching import cached
from observer.model.network import Exchange, shapes_of_strokes
from observer.model.rod.modes import (
    Modes,
    Stretch,
    ambient_field,
    end_field,
    quadrature,
    quadrature_within,
    source_field,
)
from observer.model.rod.screw import Profile, Rod

LARGEST_EXPONENT = 500.0
"""Largest sum of m·w of the films of a rod; cosh overflows at 710."""
Field = Callable[[FloatArray], FloatArray]

LEAST_LOSS = 1e-7
"""Loss, as a part of the diffusion rate α/L², of a screw that has none: a rod with films only needs one."""


def with_closed_form(rod: Rod, exchanges: Sequence[Exchange]) -> tuple[Exchange, ...]:
    """Return the exchanges that steady fields contain; in others only the modes take part.

    They leave out a film that a nut covers, which takes from that of the screw, and all if they are so strong
    that the fields have no numbers.
    """
    warming = tuple(e for e in exchanges if e.conductance_W_K > 0.0)
    per_area = rod.conductance_W_m * min(rod.profile.area if rod.profile else (1.0,))
    exponent = sum((e.conductance_W_K * e.stroke.width_m / per_area) ** 0.5 for e in warming)
    return warming if exponent + rod.fin_1_m * rod.length_m < LARGEST_EXPONENT else ()


class ScrewAtRest:
    """The steady fields of a rod, with the exchanges of its nuts beyond those of their mean temperatures."""

    def __init__(self, rod: Rod, exchanges: Sequence[Exchange]) -> None:
        """Take a rod and its exchanges, which may be none."""
        self.rod, self.exchanges = rod, tuple(exchanges)

    def source(self, stretch: Stretch) -> Field:
        """Return the rise in K per W of a source on a stretch, as a function of places (k,).

        If no heat can leave the rod, the drifting mean is left out.
        """
        return self._exchanging(partial(source_field, self._filmed, stretch), stretch)

    def end(self, side: str) -> Field:
        """Return the field in K per K of the prescribed end `side`, as a function of places (k,)."""
        return self._exchanging(partial(end_field, self._filmed, side))

    def ambient(self, x_m: FloatArray) -> FloatArray:
        """Return the field at places (k,) in K per K of the ambient."""
        field = ambient_field(self.rod, x_m)
        if not self.exchanges or self.rod.floating:
            return field
        # a uniform temperature exchanges nothing
        ends = (("left", self.rod.left), ("right", self.rod.right))
        return np.ones_like(x_m) - sum(self.end(side)(x_m) for side, end in ends if end.prescribed)

    def amplitudes(self, modes: Modes, inputs: FloatArray) -> FloatArray:
        """Return the steady amplitudes (…, N) of modes for their inputs (…, N); 0 of a drifting mean."""
        if self.exchanges:
            return np.asarray(inputs @ _settling_s(modes, self.exchanges))
        is_lost = modes.decay_1_s > 0
        return np.where(is_lost, inputs / np.where(is_lost, modes.decay_1_s, 1.0), 0.0)

    @property
    def edges_m(self) -> tuple[float, ...]:
        """The edges between sections and strokes."""
        return self._filmed.edges_m

    @cached_property
    def _filmed(self) -> Rod:
        """The rod with the exchanges as films; with m = 1 per metre, perimeters are the squares m²."""
        if not self.exchanges:
            return self.rod
        L, rod = self.rod.length_m, self.rod
        edges = {0.0, L, *rod.edges_m, *(x for e in self.exchanges for x in e.stroke)}
        edges_m = np.array(sorted(edges))
        middle_m = (edges_m[1:] + edges_m[:-1]) / 2
        area = np.broadcast_to(rod.area_at(middle_m), middle_m.shape)
        lost_1_m2 = rod.fin_1_m**2 * np.broadcast_to(rod.perimeter_at(middle_m), middle_m.shape)
        if rod.floating:
            lost_1_m2 = LEAST_LOSS / L**2 * area
        for _, G, stroke in self.exchanges:
            along = (middle_m > stroke.a_m) & (middle_m < stroke.b_m)
            lost_1_m2 = lost_1_m2 + along * G / (stroke.width_m * rod.conductance_W_m)
        profile = Profile(*(tuple(values.tolist()) for values in (edges_m, area, lost_1_m2)))
        return rod._replace(fin_1_m=1.0, profile=profile)

    @cached_property
    def _of_strokes(self) -> list[Field]:
        """The field of 1 W over each stroke in the rod with films."""
        return [partial(source_field, self._filmed, e.stroke) for e in self.exchanges]

    @cached_property
    def _heats_W_K(self) -> FloatArray:
        """The matrix from means without the heats G T̄ to these heats, (e, e)."""
        means_K_W = np.array([self._means(field) for field in self._of_strokes]).T
        passed_W_K = np.diag([e.conductance_W_K for e in self.exchanges])
        return np.asarray(passed_W_K @ np.linalg.inv(np.eye(len(passed_W_K)) - means_K_W @ passed_W_K))

    def _means(self, field: Field, kinks_m: Sequence[float] = ()) -> list[float]:
        """The mean of a field over each stroke; its slope may have kinks at `kinks_m`."""
        at = [mean_over(self._filmed, e.stroke, kinks_m) for e in self.exchanges]
        return [float(weights @ field(places_m)) for places_m, weights in at]

    def _exchanging(self, filmed: Field, kinks_m: Sequence[float] = ()) -> Field:
        """The field of a load, from its field in the rod with films and the places of its kinks."""
        if not self.exchanges:
            return filmed
        heats_W = self._heats_W_K @ self._means(filmed, kinks_m)

        def field(x_m: FloatArray) -> FloatArray:
            return filmed(x_m) + heats_W @ [of_1_W(x_m) for of_1_W in self._of_strokes]

        if not self.rod.floating:
            return field
        places_m, weights_m = quadrature(self.rod.length_m, [*self.edges_m, *kinks_m])
        mean = (weights_m * self.rod.area_at(places_m)) @ field(places_m) / self.rod.storage_m
        return lambda x_m: field(x_m) - mean


def mean_over(rod: Rod, stretch: Stretch, kinks_m: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Return places (k,) and weights (k,) of the mean over a stretch of a field with kinks at `kinks_m`."""
    if stretch.width_m == 0:
        return np.array([stretch.a_m]), np.ones(1)
    places_m, weights = quadrature_within(rod.length_m, stretch, [*rod.edges_m, *kinks_m])
    return places_m, weights / stretch.width_m


@cached(8)
def _settling_s(modes: Modes, exchanges: tuple[Exchange, ...]) -> FloatArray:
    """The matrix (N, N) from inputs of modes to their steady amplitudes."""
    lost_1_s = np.diag(modes.decay_1_s)
    for shapes in shapes_of_strokes(modes, exchanges):
        lost_1_s += (shapes.shape.T * shapes.rate_1_s) @ shapes.shape
    is_lost, settling_s = modes.decay_1_s > 0, np.zeros_like(lost_1_s)
    settling_s[np.ix_(is_lost, is_lost)] = np.linalg.inv(lost_1_s[np.ix_(is_lost, is_lost)])
    return settling_s
