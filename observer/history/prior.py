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
    """A log with one prior of its heats, as the smoother takes it.

    Attributes:
        plant: The model with the variances of the prior.
        blocks: Inputs with the laws and jumps of the prior.
        steps: Step matrices of that prior.
    """

    plant: Plant
    blocks: Sequence[Inputs]
    steps: StepCache


class HeldSteps(StepCache):
    """Steps over which heats are held constant.

    Args:
        plant: The model.
        keeps: Whether a heat persists after the step in which it jumps.
    """

    def __init__(self, plant: Plant, *, keeps: bool) -> None:
        super().__init__(plant)
        self._keeps = keeps

    def matrices(self, dt_s: float) -> StepMatrices:
        """Return the step of this length, s, without random walk within it.

        Raises:
            ValueError: If the length is negative or not finite.
        """
        step = super().matrices(dt_s)
        return step._replace(
            heat_decay=step.heat_decay * self._keeps,
            couple=np.tile(step.hold, (len(step.couple), 1)),
            walk_xx=np.zeros_like(step.walk_xx),
            walk_dx=np.zeros_like(step.walk_dx),
            walk_dd=np.zeros_like(step.walk_dd),
        )


def walking(plant: Plant, blocks: Sequence[Inputs], alpha: float = 1.0) -> Assumed:
    """Return the prior of order 1: each heat walks from its law.

    The field has no noise here: everything that heats do not explain is the sensors' noise. With noise of the
    field, no choice of the weight could separate the two.

    Args:
        plant: The model with the configured random walks.
        blocks: Inputs of the log.
        alpha: Weight of the prior, by which its variances are divided; 1 is the configuration's.
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
    """Return the prior of order 0: a step's heat is a jump from zero at its start.

    Its σ is the configured `initial_sigma_W` over √α. Laws of estimated heats are 0, and the field at the
    start is known.

    Args:
        plant: The model.
        blocks: Inputs of the log.
        alpha: Weight α of the prior.
    """
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
    """Return the jump of each heat at the start of each step by its prior.

    Args:
        plant: The model.
        inputs: K steps of a log.
        order: Order of the prior, 0 or 1.

    Returns:
        σ of the jump, W, (K, m_e), which is held over the step. The fraction of the heat before it that
        remains, (K, m_e). Both are 0 in the first row.
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
