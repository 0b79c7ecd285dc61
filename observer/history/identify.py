"""The heat history of a whole log by one of three methods."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from observer.frames import FloatArray, Inputs
from observer.history.conjugate_gradient import Convolution, descend, spread, stepwise_heats
from observer.history.history import HeatHistory, MethodOptions
from observer.history.smoother import smooth_heats
from observer.history.stacked import Prior, StackedProblem, stacked_problem, stationary
from observer.history.tikhonov import (
    NormalEquations,
    Spectrum,
    by_discrepancy,
    by_gcv,
    by_ico,
    by_l_curve,
    normal_equations,
    solve,
)
from observer.history.tolerances import Changes, less, most_probable
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings

_EXPLAINED = 1.2
"""Up to this multiple of the noise's own misfit, heats explain a log."""
_Found = tuple[FloatArray, FloatArray, dict[str, Any]]


def heat_history(
    plant: Plant,
    settings: EstimatorSettings,
    blocks: Sequence[Inputs],
    options: MethodOptions,
    tolerances: Callable[[FloatArray], Changes] | None = None,
) -> HeatHistory:
    """Return the heats over a whole log, given as consecutive blocks of inputs.

    `tolerances` returns what one standard deviation of each tolerance does to the sensors, along heats (K,
    m_e), NaN where they are not known; it is given those that the smoother estimates without any. The learnt
    part is subtracted from the readings, and the remaining uncertainty, as for the smoother, is added to σ
    for every method. Raises `UserError` where the options contradict each other, or the method cannot take
    this log.
    """
    options.check()
    first = None if tolerances is None else smooth_heats(plant, settings, blocks)
    changes = None if tolerances is None or first is None else tolerances(first.heat_W)
    if changes is not None and len(changes.learnt):
        found = most_probable(plant, settings, blocks, changes)
        history = _by_method(plant, settings, less(blocks, found.sensor_K), options)
        sigma_W = np.sqrt(history.heat_sigma_W**2 + found.variance_W2)
        history = replace(history, heat_sigma_W=sigma_W)
    elif first is not None and options.method == "smoother":
        history = first
    else:
        history = _by_method(plant, settings, blocks, options)
    return replace(history, warnings=(*history.warnings, *_that_cool(plant, blocks, history)))


def _that_cool(plant: Plant, blocks: Sequence[Inputs], history: HeatHistory) -> Iterator[str]:
    """Warn of sources whose estimated heat is negative on average, beyond σ, though their laws are not."""
    law_W = np.concatenate([block.law_W for block in blocks])[:, plant.estimated]
    names = [name for name, is_one in zip(plant.source_names, plant.estimated, strict=True) if is_one]
    for name, heat_W, sigma_W, law in zip(
        names, history.heat_W.T, history.heat_sigma_W.T, law_W.T, strict=True
    ):
        known = np.isfinite(heat_W) & np.isfinite(sigma_W)
        if known.any() and heat_W[known].mean() < -sigma_W[known].mean() and not (law < 0.0).any():
            yield (
                f"{name} would cool by {-heat_W[known].mean():.3g} W on average, which is impossible: a "
                "sensor near it, the ambient or the film is not as configured, or an effect is missing; try "
                "`observer calibrate`, then `observer discover`"
            )


def _by_method(
    plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], options: MethodOptions
) -> HeatHistory:
    """The heats without regard to tolerances."""
    if options.method == "smoother":
        return smooth_heats(plant, settings, blocks)
    as_printed = options.order == 0 or options.gradient == "central-differences"
    problem, first = stacked_problem(plant, blocks, start_known=as_printed)
    find = _tikhonov if options.method == "tikhonov" else _conjugate_gradient
    heat, sigma, details = find(plant, problem, options)
    left = problem.rise_K - Convolution(problem.response_K_W).forward(heat)
    misfit = float(np.sum(problem.whiten(left) ** 2)) / problem.measurements
    residual = problem.unexplained(left)
    return HeatHistory(
        time_s=np.concatenate([block.time_s for block in blocks]),
        heat_W=_rows(heat, first),
        heat_sigma_W=_rows(sigma, first),
        residual_K=np.vstack([np.full((first, residual.shape[1]), np.nan), residual]),
        details={**details, "misfit": misfit},
        warnings=tuple(_warnings(plant, options, misfit)),
    )


def _tikhonov(plant: Plant, problem: StackedProblem, options: MethodOptions) -> _Found:
    prior = Prior.of(plant, problem.dt_s, 1 if options.order is None else options.order)
    normal = normal_equations(problem, prior)
    alpha, details = _regularisation(normal, problem, options)
    return *solve(problem, prior, normal, alpha), {**details, "regularisation": alpha}


def _regularisation(
    normal: NormalEquations, problem: StackedProblem, options: MethodOptions
) -> tuple[float, dict[str, Any]]:
    """The weight of the prior, and how it was chosen."""
    if options.regularisation is not None:
        return options.regularisation, {}
    choice = options.parameter_choice or "gcv"
    spectrum = Spectrum.of(normal, problem.measurements)
    if choice == "ico":
        return by_ico(spectrum, options.seed)[0], {"parameter_choice": choice}
    rule = {"discrepancy": by_discrepancy, "gcv": by_gcv, "l-curve": by_l_curve}[choice]
    return rule(spectrum), {"parameter_choice": choice}


def _conjugate_gradient(plant: Plant, problem: StackedProblem, options: MethodOptions) -> _Found:
    H = Convolution(problem.response_K_W)
    walk = Prior.of(plant, problem.dt_s, 1)
    if options.gradient == "central-differences":
        still = stationary(plant)
        heat = stepwise_heats(still, problem, problem.rise_K)
        sigma = spread(problem, walk, H, lambda rise: stepwise_heats(still, problem, rise), options.seed)
        return heat, sigma, {"gradient": options.gradient}
    prior = Prior.of(plant, problem.dt_s, 1 if options.order is None else options.order)
    found = descend(problem, prior, H, problem.rise_K)
    sigma = spread(problem, walk, H, lambda rise: descend(problem, prior, H, rise).heat_W, options.seed)
    return found.heat_W, sigma, {"iterations": found.iterations}


def _warnings(plant: Plant, options: MethodOptions, misfit: float) -> list[str]:
    found = []
    if plant.moving:
        names = " and ".join(plant.source_names[source.index] for source in plant.moving)
        found.append(
            f"{options.method} takes {names} at the mean of the stroke; --method smoother follows the "
            "position"
        )
    if misfit > _EXPLAINED:
        remedy = "calibrate the configuration, or raise the sensors' noise_K"
        if options.gradient == "central-differences":
            remedy = "the steps may be too short for heat to reach the sensors; use --gradient adjoint"
        elif options.regularisation is not None:
            remedy = f"use less regularisation, {remedy}"
        found.append(
            f"the residual is {misfit**0.5:.3g} times the noise, so the heats do not explain the log; "
            f"{remedy}"
        )
    return found


def _rows(values: FloatArray, first: int) -> FloatArray:
    """Steps (T, m) as rows of the log (K, m): the first row has the first step's value, earlier ones NaN."""
    return np.vstack([np.full((first, values.shape[1]), np.nan), values[:1], values])
