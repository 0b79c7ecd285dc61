"""Estimators: designed once from a plant, then a pure step over blocks of inputs."""

from __future__ import annotations

from observer.errors import ConfigError
from observer.estimators.protocol import Estimator
from observer.model.plant import Plant
from observer.tables.estimator import EstimatorSettings


def build_estimator(plant: Plant, settings: EstimatorSettings) -> Estimator:
    """Return the estimator the settings ask for; what it does not need is not imported.

    Raises `UserError` where no gain to be trusted exists for this plant.
    """
    refuse_what_it_cannot_follow(plant, settings)
    if settings.kind == "luenberger":
        from observer.estimators.luenberger import LuenbergerEstimator  # noqa: PLC0415

        return LuenbergerEstimator(plant, settings)
    if settings.engine == "constant":
        from observer.estimators.constant_gain import ConstantGainEstimator  # noqa: PLC0415

        return ConstantGainEstimator(plant, settings)
    if settings.engine == "filterpy":
        from observer.estimators.filterpy_engine import FilterpyEstimator  # noqa: PLC0415

        return FilterpyEstimator(plant, settings)
    from observer.estimators.kalman import KalmanEstimator  # noqa: PLC0415

    return KalmanEstimator(plant, settings)


def refuse_what_it_cannot_follow(plant: Plant, settings: EstimatorSettings) -> None:
    """Raise `ConfigError` where gains are fixed and the plant has states that they do not know."""
    fixed = settings.kind == "luenberger" or settings.engine == "constant"
    if fixed and plant.coupling.states:
        raise ConfigError(
            "estimator: a node, or an effect that stores heat or delays a sensor, adds a state "
            'that fixed gains cannot follow; set kind = "kalman" and engine = "compiled"'
        )
