"""Estimators: designed once from a plant, then a pure step over blocks of inputs."""

from __future__ import annotations

from observer.estimators.protocol import Estimator
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings, Integrity
from observer.tables.outside import outside


def build_estimator(
    plant: Plant, settings: EstimatorSettings, integrity: Integrity | None = None
) -> Estimator:
    """Return the estimator the settings ask for; what it does not need is not imported.

    With `integrity` the compiled Kalman filter looks for sensor faults before it corrects.

    Raises `UserError` where no gain to be trusted exists for this plant.
    """
    if settings.kind == "luenberger":
        from observer.estimators.fixed_gain import LuenbergerEstimator  # noqa: PLC0415

        return LuenbergerEstimator(plant, settings)
    if settings.kind != "kalman":
        made: Estimator = outside(settings.kind, "estimators")(plant, settings)
        return made
    if settings.engine == "constant":
        from observer.estimators.fixed_gain import ConstantGainEstimator  # noqa: PLC0415

        return ConstantGainEstimator(plant, settings)
    if settings.engine == "filterpy":
        from observer.estimators.filterpy_engine import FilterpyEstimator  # noqa: PLC0415

        return FilterpyEstimator(plant, settings)
    from observer.estimators.kalman import KalmanEstimator  # noqa: PLC0415

    return KalmanEstimator(plant, settings, integrity)
