"""The heat history of a whole log by one of three methods."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from observer.config.estimator import EstimatorSettings
from observer.errors import UserError
from observer.frames import FloatArray, Inputs
from observer.history.conjugate_gradient import descend, draw, refuse_bent, spread, stepwise
from observer.history.history import HeatHistory, MethodOptions
from observer.history.smoother import smooth_heats
from observer.history.sweeps import Readings, Sweeps, readings
from observer.history.tikhonov import BENDS, Regularised, by_discrepancy, by_gcv, by_ico, by_l_curve, trials
from observer.history.tolerances import Changes, averaged, most_probable, without_changes
from observer.model.plant import Plant

_EXPLAINED = 1.2
"""Up to this multiple of the noise's own misfit, heats explain a log."""
_LEAST_RANGE_K = 1.0
"""The range of temperatures that counts as such: more than rounding or noise, less than what diverges."""
_LIKELY = 3.0
"""A tolerance that is off by more of its standard deviations is wrong, or something else is."""


def heat_history(
    plant: Plant,
    settings: EstimatorSettings,
    blocks: Sequence[Inputs],
    options: MethodOptions,
    tolerances: Callable[[FloatArray], Changes] | None = None,
    progress: Callable[[str], None] = lambda _text: None,
) -> HeatHistory:
    """Return the heats over a whole log, by the method of the options.

    With tolerances, their learnt part is subtracted from the readings. The remaining uncertainty is added to
    σ for every method.

    Args:
        plant: The model without uncertain parameters.
        settings: The table `[estimator]`, whose gate rejects readings.
        blocks: Consecutive blocks of inputs, K steps in total.
        options: The method and its options.
        tolerances: Returns the effect of each tolerance on the sensors, along heats (K, m_e), W, averaged
            over minutes, NaN where unknown. None takes the model as exact.
        progress: Called in each iteration of a descent.

    Returns:
        Heats with σ. Warnings name a residual beyond noise, and sources that would cool although their law
        does not.

    Raises:
        UserError: If the options contradict each other, or if the method cannot use this log.
    """
    options.check()
    first = None if tolerances is None else smooth_heats(plant, settings, blocks)
    changes = None
    if tolerances is not None and first is not None:
        changes = tolerances(averaged(blocks, plant.estimated, first.heat_W))
    if changes is not None and len(changes.learnt):
        estimate = most_probable(plant, settings, blocks, changes)
        history = _by_method(plant, settings, without_changes(blocks, estimate.sensor_K), options, progress)
        of_method = options.regularisation is not None or options.gradient == "central-differences"
        if history.warnings and not of_method and estimate.largest <= _LIKELY:
            equation = Regularised(plant, settings, without_changes(blocks, estimate.whole_K), 1)
            if np.nanmean(equation.solve(1.0).residual ** 2 / plant.noise_R_K2) <= _EXPLAINED:
                history = replace(history, warnings=(_tolerated_misfit(history.details["misfit"]),))
        sigma_W = np.sqrt(history.heat_sigma_W**2 + estimate.variance_W2)
        history = replace(history, heat_sigma_W=sigma_W)
    elif first is not None and options.method == "smoother":
        history = first
    else:
        history = _by_method(plant, settings, blocks, options, progress)
    return replace(history, warnings=(*history.warnings, *_that_cool(plant, blocks, history)))


def _that_cool(plant: Plant, blocks: Sequence[Inputs], history: HeatHistory) -> Iterator[str]:
    """Yield a warning for each source whose estimated heat is negative on average, beyond σ, although its
    law is not.
    """
    law_W = np.concatenate([block.law_W for block in blocks])[:, plant.estimated]
    names = [name for name, is_one in zip(plant.source_names, plant.estimated, strict=True) if is_one]
    for name, heat_W, sigma_W, law in zip(
        names, history.heat_W.T, history.heat_sigma_W.T, law_W.T, strict=True
    ):
        finite = np.isfinite(heat_W) & np.isfinite(sigma_W)
        if finite.any() and heat_W[finite].mean() < -sigma_W[finite].mean() and not (law < 0.0).any():
            yield (
                f"{name} would cool by {-heat_W[finite].mean():.3g} W on average, which is impossible: a "
                "sensor near it, the ambient or the film is not as configured, or an effect is missing; try "
                "`observer calibrate`, then `observer discover`"
            )


def refuse_diverged(history: HeatHistory, blocks: Sequence[Inputs], most_W: float, method: str) -> None:
    """Refuse a history that has diverged.

    Without heat a screw stays between its first temperatures and those around it. So its residual is within
    the range of all measured temperatures.

    Args:
        history: The history.
        blocks: Inputs of the log.
        most_W: Largest heat that a screw can take, W.
        method: Name of the method, for the message.

    Raises:
        UserError: If the rms of a heat exceeds `most_W`, or if the heats explain less than no heat at all
            would.
    """
    heat_W, residual_K = _largest_rms(history.heat_W), _largest_rms(history.residual_K)
    temperatures_degC = np.concatenate(
        [values.ravel() for block in blocks for values in (block.y_degC[block.usable], block.z_end)]
    )
    range_K = max(float(np.ptp(temperatures_degC[np.isfinite(temperatures_degC)])), _LEAST_RANGE_K)
    if heat_W > most_W:
        fact = f"a heat is {heat_W:.3g} W (r.m.s.), and no screw takes more than {most_W:.3g} W"
    elif residual_K > range_K:
        fact = f"it misses a sensor by {residual_K:.3g} K (r.m.s.), more than without any heat"
    else:
        return
    remedy = "use --method smoother, or longer steps and sensors nearer to the sources"
    if method == "smoother":
        remedy = "compare the configuration with the machine (`observer check`, `observer calibrate`)"
    raise UserError(f"{method} has diverged: {fact}; {remedy}")


def _largest_rms(columns: FloatArray) -> float:
    """Return the largest r.m.s. of the columns, without NaN; infinite if a value is."""
    with np.errstate(over="ignore"):
        means = [
            float(np.mean(column[~np.isnan(column)] ** 2))
            for column in columns.T
            if not np.isnan(column).all()
        ]
    return float(np.sqrt(max(means, default=0.0)))


def _by_method(
    plant: Plant,
    settings: EstimatorSettings,
    blocks: Sequence[Inputs],
    options: MethodOptions,
    progress: Callable[[str], None],
) -> HeatHistory:
    """Return the heats without regard to tolerances."""
    if options.method == "smoother":
        return smooth_heats(plant, settings, blocks)
    if options.method == "tikhonov":
        history = _tikhonov(plant, settings, blocks, options)
    else:
        history = _conjugate_gradient(plant, blocks, options, progress)
    weighted = history.residual_K**2 / plant.noise_R_K2
    misfit = float(np.nanmean(weighted))
    return replace(
        history,
        time_s=np.concatenate([block.time_s for block in blocks]),
        details={**history.details, "misfit": misfit},
        warnings=tuple(_warnings(options, misfit)),
    )


def _tikhonov(
    plant: Plant, settings: EstimatorSettings, blocks: Sequence[Inputs], options: MethodOptions
) -> HeatHistory:
    equation = Regularised(plant, settings, blocks, 1 if options.order is None else options.order)
    alpha, details = _regularisation(equation, options)
    solution = equation.solve(alpha)
    details["regularisation"] = alpha
    return HeatHistory(np.zeros(0), solution.heat, solution.sigma, solution.residual, details)


def _regularisation(equation: Regularised, options: MethodOptions) -> tuple[float, dict[str, Any]]:
    """Return the weight of the prior, and how it was chosen."""
    if options.regularisation is not None:
        return options.regularisation, {}
    choice = options.parameter_choice or "gcv"
    if choice == "ico":
        return by_ico(equation.trial, equation.top, options.seed)[0], {"parameter_choice": choice}
    if choice == "l-curve":
        return by_l_curve(equation.trial, trials(equation.top, BENDS)), {"parameter_choice": choice}
    rule = by_discrepancy if choice == "discrepancy" else by_gcv
    return rule(equation.trial, trials(equation.top)), {"parameter_choice": choice}


def _conjugate_gradient(
    plant: Plant, blocks: Sequence[Inputs], options: MethodOptions, progress: Callable[[str], None]
) -> HeatHistory:
    refuse_bent(plant)
    as_printed = options.gradient == "central-differences"
    order = 0 if as_printed or options.order == 0 else 1
    log = readings(plant, blocks, order)
    drawn = draw(Sweeps(plant, log.inputs, 1, start_known=order == 0), log.weight_1_K, options.seed)
    details: dict[str, Any]
    if as_printed:
        find = stepwise(plant, log)
        heat, rows = find(log.rise_K)
        others = [find(drawn.rise_K[:, :, c])[0] for c in range(drawn.rise_K.shape[2])]
        sigma, details = spread(drawn, np.stack(others, axis=2)), {"gradient": options.gradient}
    else:
        logs = np.concatenate([log.rise_K[:, :, None], drawn.rise_K], axis=2)
        descent = descend(Sweeps(plant, log.inputs, order), log.weight_1_K, logs, progress)
        heat, rows = descent.heat_W[:, :, 0], descent.rows_K[:, :, 0]
        sigma, details = spread(drawn, descent.heat_W[:, :, 1:]), {"iterations": int(descent.iterations[0])}
    heat = heat + log.inputs.law_W[:, plant.estimated]
    heat, sigma, residual = (_after(log, values) for values in (heat, sigma, log.unexplained(rows)))
    return HeatHistory(np.zeros(0), heat, sigma, residual, details)


def _warnings(options: MethodOptions, misfit: float) -> list[str]:
    if misfit <= _EXPLAINED:
        return []
    remedy = "calibrate the configuration, or raise the sensors' noise_K"
    if options.gradient == "central-differences":
        remedy = "the steps may be too short for heat to reach the sensors; use --gradient adjoint"
    elif options.regularisation is not None:
        remedy = f"use less regularisation, {remedy}"
    return [
        f"the residual is {misfit**0.5:.3g} times the noise, so the heats do not explain the log; {remedy}"
    ]


def _tolerated_misfit(misfit: float) -> str:
    """Return the warning about a misfit that tolerances explain only if the considered ones change too."""
    return (
        f"the residual is {misfit**0.5:.3g} times the noise, which [tolerance] explains only by quantities "
        "that are not fitted (material, positions); σ includes it, and the smoother treats it as noise of "
        "the field"
    )


def _after(log: Readings, values: FloatArray) -> FloatArray:
    """Return values (k, …) with NaN rows for the log's rows before the first measurement."""
    return np.vstack([np.full((log.first, values.shape[1]), np.nan), values])
