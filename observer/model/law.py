"""The heat laws of the configuration."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from observer.config.laws import SPEED_LAWS, BearingFriction
from observer.config.sections import Source, owner, part_of_heat
from observer.frames import FloatArray
from observer.physics import friction

Law = Callable[..., FloatArray]
"""Heat in W from the law's channels, one array (k,) each, in the order of `law_channels`."""


def heat_law(source: Source, sources: Sequence[Source], screw_m: float) -> Law:
    """Return a source's heat in W as a function of its law's channels.

    - Friction: scale · share · duty · M(n) (π/30) |n|. The torque M is given, or that of a bearing (Palmgren)
      or a nut (preload, load, efficiency).

    - Friction of a nut that turns too: `relative_heat_W`, or `dual_drive_heat_W` with a torque of its own.

    - Bearing in one number: scale · duty · heat_W_rpm · |n|.

    - Measured: scale · power.

    - Constant: scale · heat_W, with a drive_channel only while that is not zero.

    - Part of another source: scale · its heat / ratio (Kim et al., eqs. 28 and 29).

    Without a law, the heat is 0 W. A law without channels takes one array, for its shape.

    Args:
        source: The source with its law.
        sources: All sources, for a law that follows another.
        screw_m: Length of the screw, m, for `stroke_share`.
    """
    if source.law == "heat_of":
        other = heat_law(owner(source, sources), sources, screw_m)
        return _times(other, part_of_heat(source))
    if source.law == "power_channel":
        return lambda power_W: source.scale * power_W
    if source.law not in SPEED_LAWS:
        heat_W = source.scale * (source.heat_W or 0.0)
        if source.drive_channel is None:
            return lambda shape: np.full_like(shape, heat_W)
        return lambda drive: np.where(drive != 0.0, heat_W, 0.0)
    factor, of_speed = _factor(source, screw_m), _of_speed(source)
    return of_speed if factor == 1.0 else _times(of_speed, factor)


def _times(law: Law, factor: float) -> Law:
    """A law times a factor."""
    return lambda *channels: factor * law(*channels)


def _factor(source: Source, screw_m: float) -> float:
    """The factor of a law of the speed."""
    factor = source.scale * source.duty
    if source.heat_W_rpm is None:
        factor *= source.share
    if source.stroke_share and source.stroke_m is not None:
        factor *= friction.stroke_share(source.stroke_m, screw_m)
    return factor


def _of_speed(source: Source) -> Law:
    """A law of the speed, without its factor."""
    if source.bearing is not None:
        return _bearing(source.bearing)
    if source.heat_W_rpm is not None:
        return _times(np.abs, source.heat_W_rpm)
    torque_Nm = _nut_torque_Nm(source)
    if source.nut_speed_channel is None:
        return lambda speed_rpm: friction.friction_heat_W(torque_Nm, speed_rpm)
    if source.nut_torque_Nm is None:
        return lambda speed_rpm, nut_rpm: friction.relative_heat_W(torque_Nm, speed_rpm, nut_rpm)
    own_Nm = source.nut_torque_Nm
    return lambda speed_rpm, nut_rpm: friction.dual_drive_heat_W(torque_Nm, own_Nm, speed_rpm, nut_rpm)


def _nut_torque_Nm(source: Source) -> float:
    """The friction torque between nut and screw: given, or by preload, load and efficiency."""
    rubbing = source.nut_friction
    if rubbing is None:
        return source.torque_Nm or 0.0
    lead_m = rubbing.lead_m or source.lead_m or 0.0
    drag_Nm = friction.preload_torque_Nm(rubbing.preload_N, rubbing.efficiency, lead_m)
    return drag_Nm + friction.load_friction_torque_Nm(rubbing.axial_load_N, rubbing.efficiency, lead_m)


def _bearing(bearing: BearingFriction) -> Law:
    """Palmgren's law of one bearing or several equal ones."""
    kind = friction.BEARING_TYPES[bearing.type]
    load_N = bearing.load_N
    if load_N is None:
        load_N = friction.bearing_load_N(kind, bearing.axial_load_N or 0.0, bearing.radial_load_N or 0.0)
    f1 = bearing.f1
    if f1 is None:
        f1 = friction.load_factor(kind, bearing.static_load_N or 0.0, bearing.static_rating_N or 1.0)
    f0 = kind.f0 if bearing.f0 is None else bearing.f0
    nu_mm2_s, dry_Nm = _viscosity_mm2_s(bearing), friction.load_torque_Nm(f1, load_N, bearing.mean_diameter_m)

    def heat_W(speed_rpm: FloatArray) -> FloatArray:
        wet_Nm = friction.lubricant_torque_Nm(speed_rpm, f0, nu_mm2_s, bearing.mean_diameter_m)
        return bearing.count * friction.friction_heat_W(dry_Nm + wet_Nm, speed_rpm)

    return heat_W


def _viscosity_mm2_s(bearing: BearingFriction) -> float:
    """The lubricant's viscosity, given or at its temperature."""
    if bearing.viscosity_mm2_s is not None:
        return bearing.viscosity_mm2_s
    return friction.viscosity_mm2_s(
        bearing.lubricant_degC or 0.0, bearing.viscosity_40_mm2_s or 0.0, bearing.viscosity_100_mm2_s or 0.0
    )
