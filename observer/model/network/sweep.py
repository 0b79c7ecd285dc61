"""What a nut that sweeps over its stroke exchanges with a node, place by place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.coupling import Spreads
from observer.model.network.network import Attached
from observer.model.rod.modes import Modes
from observer.model.rod.sources import mean_stretch, nut_stretch
from observer.model.rod.static import Stretch, quadrature_within
from observer.model.rod.truncation import modal_input
from observer.tables.sections import Description, Source

SMALL = 1e-3
"""Rate of a shape against the largest, below which it is left out."""
NO_SWEEP = 0.05
"""A stroke as long as the nut, to this part of it, is none: sweeping and standing cannot be told apart."""
STANDING_PLACES = 9


class Shapes(NamedTuple):
    """How what a sweeping nut, the `source`, exchanges with its nodes fades: orthonormal shapes `shape`
    (e, N) at the rates `rate_1_s` (e,), and the squared size `swept` of its column over the whole stroke.
    """

    source: int
    rate_1_s: FloatArray
    shape: FloatArray
    swept: float


def shapes_of_strokes(modes: Modes, machine: Description, beside: Attached) -> Iterator[Shapes]:
    """Yield what nuts that sweep exchange with their nodes on top of the exchange at the mean temperature.

    Each place under the nut exchanges by itself (Li 2022, eq. 45): over a stroke swept evenly, w = 1/stroke,
    the modes lose G/(kA) ∫ w θ_i θ_j dx, of which the mean temperature carries G/(kA) ∫ w θ_i dx ∫ w θ_j dx.
    """
    kA = modes.rod.conductance_W_m
    for j, source in enumerate(machine.source):
        G = sum(tie for _, place, tie in beside.ties if place == j)
        if source.shape != "nut" or G == 0.0:
            continue
        stroke = mean_stretch(source, machine.screw)
        if abs(stroke.width_m - (source.length_m or 0.0)) < NO_SWEEP * stroke.width_m:
            continue
        nodes, weights = quadrature_within(modes.rod.length_m, stroke)
        theta, weights = modes.theta(nodes), weights / stroke.width_m
        mean = weights @ theta
        own, shape = np.linalg.eigh((theta * weights[:, None]).T @ theta - np.multiply.outer(mean, mean))
        felt = own > SMALL * own.max()
        yield Shapes(j, G / kA * own[felt], shape[:, felt].T, float(mean @ mean) / kA**2)


def spreads(modes: Modes, machine: Description, beside: Attached, moving: Sequence[int]) -> Spreads:
    """Return the shapes of the sources that are `moving`."""
    m = len(machine.source)
    swept, at_rest = np.zeros(m), np.ones(m)
    found = [s for s in shapes_of_strokes(modes, machine, beside) if s.source in moving]
    for s in found:
        source = machine.source[s.source]
        swept[s.source] = s.swept
        at_rest[s.source] = _at_rest(modes, source, mean_stretch(source, machine.screw))
    shape = np.vstack([np.zeros((0, len(modes))), *(s.shape for s in found)])
    return Spreads(
        np.array([s.source for s in found for _ in s.rate_1_s], dtype=np.int64),
        np.concatenate([np.zeros(0), *(s.rate_1_s for s in found)]),
        shape,
        shape,
        swept,
        at_rest,
    )


def _at_rest(modes: Modes, source: Source, stroke: Stretch) -> float:
    """The squared size of the input column of a nut that stands, mean over its stroke."""
    nut_m, L = source.length_m or 0.0, modes.rod.length_m
    places = np.linspace(stroke.a_m, stroke.b_m, STANDING_PLACES).tolist()
    return float(np.mean([np.sum(modal_input(modes, nut_stretch(x, nut_m, L)) ** 2) for x in places]))
