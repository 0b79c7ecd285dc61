"""The prior of the heats, before a log is read, in two orders.

Order 1: each heat walks from its law, by the configuration's random walk and the law's own jumps; the field
at the start is uncertain. This is the smoother's prior, without noise of the field. Order 0, as the papers
print it: the heats of all steps are independent, around zero, and the screw has one temperature at the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.estimators.steps import StepCache
from observer.frames import FloatArray, Inputs
from observer.model.discretise import StepMatrices, quantise, step_matrices
from observer.model.plant import Plant


class Assumed(NamedTuple):
    """A plant, blocks of inputs, and the steps between them, with one prior of the heats in them."""

    plant: Plant
    blocks: Sequence[Inputs]
    steps: StepCache


class HeldSteps(StepCache):
    """Steps over which heats are held: a heat jumps at the start of a step, and persists after it only
    with `keeps`.
    """

    def __init__(self, plant: Plant, *, keeps: bool) -> None:
        super().__init__(plant)
        self._keeps = keeps

    def matrices(self, dt_s: float) -> StepMatrices:
        """Return the step of that length."""
        step = super().matrices(dt_s)
        return step._replace(
            heat_decay=step.heat_decay * self._keeps,
            couple=np.tile(step.hold, (len(step.couple), 1)),
            walk_xx=np.zeros_like(step.walk_xx),
            walk_dx=np.zeros_like(step.walk_dx),
            walk_dd=np.zeros_like(step.walk_dd),
        )


def walking(plant: Plant, blocks: Sequence[Inputs], alpha: float = 1.0) -> Assumed:
    """Return the prior of order 1 at the weight `alpha`: with 1 it is the configuration's.

    The field has no noise here: everything that heats do not explain is the sensors' noise. With noise of the
    field, no choice of the weight could separate the two.
    """
    plant = replace(
        plant,
        field_noise_Q=np.zeros_like(plant.field_noise_Q),
        random_walk_W2_s=plant.random_walk_W2_s / alpha,
        initial_sigma_W=plant.initial_sigma_W / np.sqrt(alpha),
        law_uncertainty=plant.law_uncertainty / np.sqrt(alpha),
    )
    return Assumed(plant, blocks, StepCache(plant))


def independent(plant: Plant, blocks: Sequence[Inputs], alpha: float = 1.0) -> Assumed:
    """Return the prior of order 0 at the weight `alpha`: a step's heat is a jump from zero at its start."""
    zeros = np.zeros(len(plant.initial_sigma_W))
    stepwise_plant = replace(
        plant,
        prior_P=np.zeros_like(plant.prior_P),
        field_noise_Q=np.zeros_like(plant.field_noise_Q),
        initial_sigma_W=zeros,
        random_walk_W2_s=zeros,
        heat_decay_1_s=zeros,
        law_uncertainty=np.ones(len(zeros)),
    )
    jump_W = np.zeros(len(plant.estimated))
    jump_W[plant.estimated] = plant.initial_sigma_W / np.sqrt(alpha)
    without_laws = [
        block._replace(
            law_W=np.where(plant.estimated, 0.0, block.law_W), law_jump_W=np.tile(jump_W, (len(block), 1))
        )
        for block in blocks
    ]
    return Assumed(stepwise_plant, without_laws, HeldSteps(stepwise_plant, keeps=False))


def jumps_W(plant: Plant, inputs: Inputs, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the σ (K, m_e) in W of each heat's jump at the start of each step, and the remaining fraction
    (K, m_e).

    The jump is held over the step. The fraction is that of the heat before it. Both are 0 in the first row.
    """
    sigma_W, keep = np.zeros((2, len(inputs), len(plant.initial_sigma_W)))
    if order == 0:
        sigma_W[1:] = plant.initial_sigma_W
        return sigma_W, keep
    lengths_s, index = np.unique(quantise(inputs.dt_s), return_inverse=True)
    steps = [step_matrices(plant, float(dt_s)) for dt_s in lengths_s]
    jump_W = plant.law_uncertainty * inputs.law_jump_W[:, plant.estimated]
    variance = np.array([step.walk_dd for step in steps])[index] + jump_W**2
    keep[1:] = np.array([step.heat_decay for step in steps])[index][1:]
    variance[1:2] += (keep[1:2] * plant.initial_sigma_W) ** 2
    sigma_W[1:] = np.sqrt(variance[1:])
    return sigma_W, keep
