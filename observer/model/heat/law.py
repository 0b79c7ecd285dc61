"""The heat laws of the configuration."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from observer.frames import FloatArray
from observer.sections import Source

RAD_S_PER_RPM = math.pi / 30


def law_channel(source: Source) -> str | None:
    """Return the channel that a source's heat law reads, or None where it has no law."""
    if source.power_channel is not None:
        return source.power_channel
    if source.torque_Nm is not None or source.heat_W_rpm is not None:
        return source.speed_channel
    return source.drive_channel


def heat_law(source: Source) -> Callable[[FloatArray], FloatArray]:
    """Return the heat in W as a function of the law's channel.

    Friction torque: scale · share · torque · |ω| (Kim et al., eq. 28, without its stroke factor); bearing:
    scale · heat_W_rpm · |n|; measured power: scale · power; constant heat: scale · heat_W, with a
    drive_channel only while that is not zero. A source without a law has none: 0 W.
    """
    if source.power_channel is not None:
        return lambda power_W: source.scale * power_W
    if source.torque_Nm is not None:
        W_rpm = source.scale * source.share * source.torque_Nm * RAD_S_PER_RPM
        return lambda speed_rpm: np.asarray(W_rpm * np.abs(speed_rpm))
    if source.heat_W_rpm is not None:
        W_rpm = source.scale * source.heat_W_rpm
        return lambda speed_rpm: np.asarray(W_rpm * np.abs(speed_rpm))
    heat_W = source.scale * (source.heat_W or 0.0)
    if source.drive_channel is not None:
        return lambda drive: np.where(drive != 0.0, heat_W, 0.0)
    return lambda values: np.full_like(values, heat_W)
