"""Estimators: designed once from a plant, then a pure step over blocks of inputs."""

from __future__ import annotations

import inspect

from observer.config.estimator import EstimatorSettings, Integrity
from observer.config.outside import outside
from observer.errors import UserError
from observer.estimators.protocol import Estimator
from observer.model.plant import Plant


def build_estimator(
    plant: Plant, settings: EstimatorSettings, integrity: Integrity | None = None
) -> Estimator:
    """Return the estimator the settings ask for; what it does not need is not imported.

    Args:
        plant: The model. With its tolerances (`build_plant` with `learns`), σ contain them.
        settings: The table `[estimator]`. A `kind` from outside is called as `kind(plant, settings)`.
        integrity: The table `[integrity]`. With it the compiled Kalman filter screens readings for sensor
            faults before it corrects, and a bank of filters bounds its errors. The other estimators ignore
            it. None switches both off.

    Returns:
        An estimator designed for this plant. Its gains and step matrices are cached, so one object serves
        many runs.

    Raises:
        UserError: If no gain exists for the constant or the Luenberger gain. Also if a class from outside
            cannot be called with plant and settings, or lacks `layout`, `initial` or `run`.
    """
    if settings.kind == "luenberger":
        from observer.estimators.fixed_gain import LuenbergerEstimator  # noqa: PLC0415

        return LuenbergerEstimator(plant, settings)
    if settings.kind != "kalman":
        return _from_outside(settings.kind, plant, settings)
    if settings.engine == "constant":
        from observer.estimators.fixed_gain import ConstantGainEstimator  # noqa: PLC0415

        return ConstantGainEstimator(plant, settings)
    if settings.engine == "filterpy":
        from observer.estimators.filterpy_engine import FilterpyEstimator  # noqa: PLC0415

        return FilterpyEstimator(plant, settings)
    from observer.estimators.kalman import KalmanEstimator  # noqa: PLC0415

    return KalmanEstimator(plant, settings, integrity)


def _from_outside(kind: str, plant: Plant, settings: EstimatorSettings) -> Estimator:
    """Design an estimator of the user. Raises `UserError` where its class is not one."""
    design = outside(kind, "estimators")
    try:
        inspect.signature(design).bind(plant, settings)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"estimator: {kind} cannot be called with a plant and the estimator's settings ({error}); give "
            "it __init__(self, plant, settings)"
        ) from None
    estimator: Estimator = design(plant, settings)
    missing = [name for name in ("layout", "initial", "run") if not hasattr(estimator, name)]
    if missing:
        raise UserError(f"estimator: {kind} has no {' and no '.join(missing)}; an estimator needs them")
    return estimator
