"""What a nut that sweeps over its stroke exchanges with a node, place by place."""

from __future__ import annotations

import numpy as np

from observer.model.coupling import Spreads
from observer.model.network.attach import Attached
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


def spreads(modes: Modes, machine: Description, beside: Attached) -> Spreads:
    """Return what nuts that sweep exchange with their nodes on top of the exchange at the mean temperature.

    Each place under the nut exchanges by itself (Li 2022, eq. 45): over a stroke swept evenly, w = 1/stroke,
    the modes lose G/(kA) ∫ w θ_i θ_j dx, of which the mean temperature carries G/(kA) ∫ w θ_i dx ∫ w θ_j dx.
    """
    m, kA = len(machine.source), modes.rod.conductance_W_m
    sources, rates, shapes = [], [np.zeros(0)], [np.zeros((0, len(modes)))]
    swept, at_rest = np.zeros(m), np.ones(m)
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
        sources += [j] * int(felt.sum())
        rates.append(G / kA * own[felt])
        shapes.append(shape[:, felt].T)
        swept[j], at_rest[j] = float(mean @ mean) / kA**2, _at_rest(modes, source, stroke)
    return Spreads(
        np.array(sources, dtype=np.int64), np.concatenate(rates), np.vstack(shapes), swept, at_rest
    )


def _at_rest(modes: Modes, source: Source, stroke: Stretch) -> float:
    """The squared size of the input column of a nut that stands, mean over its stroke."""
    nut_m, L = source.length_m or 0.0, modes.rod.length_m
    places = np.linspace(stroke.a_m, stroke.b_m, STANDING_PLACES).tolist()
    return float(np.mean([np.sum(modal_input(modes, nut_stretch(x, nut_m, L)) ** 2) for x in places]))
