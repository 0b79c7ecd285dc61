"""The models that cannot be exported, with the reasons."""

from __future__ import annotations

from observer.config.effects.terms import Fade, LawFactor, Radiation, RisingFilm, SpeedLoss, StrokeEnds, Term
from observer.config.machine import Config
from observer.config.outside import is_outside
from observer.errors import ConfigError
from observer.model.drive import Drive
from observer.model.plant import Plant

_WHY: tuple[tuple[type[Term], str], ...] = (
    (LawFactor, "changes a heat law with the time run"),
    (SpeedLoss, "is a loss that changes with the speed or has a temperature of its own"),
    (Radiation, "changes the loss with the temperature"),
    (RisingFilm, "changes the loss with the temperature"),
    (Fade, "changes a heat law with the temperature"),
    (StrokeEnds, "follows where the nut turns"),
)


def refuse_unexportable(config: Config, plant: Plant | None = None, drive: Drive | None = None) -> None:
    """Reject a model that varies with anything but the position of a nut.

    Call it first with the configuration alone, since some models cannot be built for an export.

    Args:
        config: The configuration.
        plant: Its plant; None if it is not built yet.
        drive: Its drive; None if it is not built yet.

    Raises:
        ConfigError: With the key and the remedy: for an external estimator, a source that follows another, an
            effect or film that changes the matrices, displacements, drifts, or a clearance in a support.
    """
    if is_outside(config.estimator.kind, "estimators"):
        raise ConfigError(
            f'estimator.kind = "{config.estimator.kind}" is an external class, which no '
            'controller can run; export with kind = "kalman" or "luenberger"'
        )
    if following := [s.name for s in config.source if s.follows]:
        raise ConfigError(
            f"source {following[0]}: follows another heat, which an export does not know; remove follows, "
            "and give each heat a sensor of its own"
        )
    for effect in config.effect:
        for term in effect.terms(config):
            for kind, why in _WHY:
                if isinstance(term, kind):
                    raise ConfigError(
                        f'effect "{effect.kind}" {why}, and the export has constant matrices; remove it, or '
                        "replace it by its mean, such as surface.convection_W_m2K at the usual speed"
                    )
    if any(sensor.kind == "displacement" for sensor in config.sensor):
        raise ConfigError(
            "displacements come at irregular times, and the export has constant gains for "
            "thermocouples; remove "
            'the sensors of kind = "displacement"'
        )
    if config.surface.speed_channel is not None:
        raise ConfigError(
            "surface.speed_channel changes the loss with the speed, and the export has constant matrices; "
            "give surface.speed_rpm, the usual speed"
        )
    if drive is not None and any(rate != 0.0 for rate in drive.read.rate_K_h):
        raise ConfigError(
            "an effect drifts with the hours since the start, which a controller does not count; remove "
            "ambient_drift and sensor_drift"
        )
    if plant is not None and plant.coupling.active:
        raise ConfigError(
            "a body or node is linked to a nut that moves, and the export has constant matrices; link it to "
            "a fixed source, or leave it out"
        )
    if plant is not None and plant.rows.restraint is not None and not plant.rows.restraint.linear:
        raise ConfigError(
            "supports.gap_m makes the thermal error bend where the gap closes, and the export has constant "
            "rows; export with gap_m = 0"
        )
