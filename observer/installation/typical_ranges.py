"""Typical ranges of values, and the unit in which a value outside its range was probably given.

The keys are those of the configuration with the places of lists and the names of drivers and ends left out:
`source.torque_Nm`, `drivers.*.period_s`. Nothing is refused here; the hard bounds are in `quantities`.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.protocol import modicon
from observer.units import BY_NAME, Unit


@dataclass(frozen=True, slots=True)
class TypicalRange:
    """The usual range of a quantity; 0 is always usual.

    Attributes:
        low: Smallest usual value, in the key's unit.
        high: Largest usual value.
        units: Units in which such a value is given by mistake.
        signed: Whether the range holds for the value itself, not for its size.
    """

    low: float
    high: float
    units: tuple[Unit, ...] = ()
    signed: bool = False

    def holds(self, value: float) -> bool:
        """Return whether a value is usual."""
        return value == 0.0 or self.low <= (value if self.signed else abs(value)) <= self.high

    def meant(self, value: float) -> list[tuple[float, Unit]]:
        """Return the usual values that it may stand for, in the key's unit, each with the mistaken unit."""
        converted = [(unit.to_base(value), unit) for unit in self.units]
        return [(v, unit) for v, unit in converted if v != 0.0 and self.holds(v)]


def _of(symbol: str, size: float) -> Unit:
    """A unit that people write by mistake, in those of the key."""
    return Unit(symbol, factor=size)


_MM, _UM, _MS, _MW = (BY_NAME["mm"],), (BY_NAME["um"],), (BY_NAME["ms"],), (BY_NAME["mW"],)
_AIR = TypicalRange(-40.0, 60.0, (BY_NAME["kelvin"], BY_NAME["degF"]), signed=True)
_PERCENT = TypicalRange(0.0, 1.0, (_of("%", 1e-2),))
_PLACE = TypicalRange(0.0, 15.0, _MM)
_CONDUCTIVITY = TypicalRange(
    3.0, 450.0, (_of("kW/mK", 1e3), _of("W/cmK", 1e2), _of("W/mmK", 1e3), _of("mW/mK", 1e-3))
)
_FILM = TypicalRange(0.5, 500.0, (_of("kW/m²K", 1e3), _of("W/cm²K", 1e4), _of("W/mm²K", 1e6)))
_STIFFNESS = TypicalRange(1e6, 1e11, (_of("N/µm", 1e6), _of("N/mm", 1e3)))
_TORQUE = TypicalRange(1e-4, 50.0, (_of("Nmm", 1e-3), _of("Ncm", 1e-2)))
_FORCE = TypicalRange(0.1, 1e6, (BY_NAME["kN"],))
_LEAD = TypicalRange(5e-4, 0.12, _MM)

TYPICAL: dict[str, TypicalRange] = {
    "screw.length_m": TypicalRange(0.005, 15.0, _MM),
    "screw.diameter_m": TypicalRange(0.002, 1.5, _MM),
    "screw.conductivity_W_mK": _CONDUCTIVITY,
    "screw.density_kg_m3": TypicalRange(1000.0, 20e3, (_of("g/cm³", 1e3),)),
    "screw.specific_heat_J_kgK": TypicalRange(120.0, 2500.0, (_of("kJ/kgK", 1e3), _of("kcal/kgK", 4187.0))),
    "screw.expansion_1_K": TypicalRange(5e-7, 5e-5, (_of("· 10⁻⁶/K", 1e-6), _of("mm/(m K)", 1e-3))),
    "surface.convection_W_m2K": _FILM,
    "surface.air_degC": _AIR,
    "surface.gap_m": TypicalRange(1e-4, 0.5, _MM),
    "surface.height_m": TypicalRange(1e-3, 15.0, _MM),
    "surface.thread_lead_m": _LEAD,
    "surface.ball_radius_m": TypicalRange(1e-4, 0.03, _MM),
    "ambient.temperature_degC": _AIR,
    "output.reference_degC": _AIR,
    "output.positions_m": _PLACE,
    "boundary.*.coefficient_W_m2K": TypicalRange(0.5, 1e5, _FILM.units),
    "source.length_m": TypicalRange(0.003, 2.0, _MM),
    "source.stroke_m": _PLACE,
    "source.position_m": _PLACE,
    "source.from_m": _PLACE,
    "source.to_m": _PLACE,
    "source.lead_m": _LEAD,
    "source.torque_Nm": _TORQUE,
    "source.nut_torque_Nm": _TORQUE,
    "source.heat_W_rpm": TypicalRange(0.0, 2.0, (_of("mW/rpm", 1e-3),)),
    "source.heat_W": TypicalRange(1e-3, 5e3, _MW),
    "source.share": _PERCENT,
    "source.duty": _PERCENT,
    "source.bearing.mean_diameter_m": TypicalRange(0.003, 1.0, _MM),
    "source.bearing.load_N": _FORCE,
    "source.bearing.axial_load_N": _FORCE,
    "source.bearing.static_rating_N": TypicalRange(100.0, 1e7, (BY_NAME["kN"],)),
    "source.nut_friction.lead_m": _LEAD,
    "source.nut_friction.preload_N": _FORCE,
    "source.nut_friction.axial_load_N": _FORCE,
    "source.nut_friction.efficiency": TypicalRange(0.5, 1.0, (_of("%", 1e-2),)),
    "node.capacity_J_K": TypicalRange(0.1, 1e7, (_of("kJ/K", 1e3),)),
    "link.area_m2": TypicalRange(1e-8, 20.0, (_of("mm²", 1e-6), _of("cm²", 1e-4))),
    "link.length_m": TypicalRange(1e-5, 5.0, _MM),
    "link.inner_diameter_m": TypicalRange(1e-3, 2.0, _MM),
    "link.outer_diameter_m": TypicalRange(1e-3, 2.0, _MM),
    "link.gap_m": TypicalRange(1e-8, 0.01, (*_UM, *_MM)),
    "link.conductivity_W_mK": TypicalRange(0.01, 450.0, (_of("mW/mK", 1e-3),)),
    "sensor.position_m": _PLACE,
    "sensor.noise_K": TypicalRange(1e-4, 5.0, (_of("mK", 1e-3),)),
    "estimator.period_s": TypicalRange(0.001, 120.0, _MS),
    "supports.stiffness_first_N_m": _STIFFNESS,
    "supports.stiffness_second_N_m": _STIFFNESS,
    "supports.elastic_modulus_Pa": TypicalRange(1e10, 1e12, (_of("GPa", 1e9), _of("MPa", 1e6))),
    "supports.gap_m": TypicalRange(1e-9, 0.01, (*_UM, *_MM)),
    "supports.preload_N": _FORCE,
    "compensation.travel_m": _PLACE,
    "compensation.reference_m": _PLACE,
    "drivers.*.period_s": TypicalRange(0.005, 60.0, _MS),
    "drivers.*.timeout_s": TypicalRange(0.01, 60.0, _MS),
    "drivers.*.counts_per_m": TypicalRange(1e4, 1e12, (_of("counts per mm", 1e3), _of("counts per µm", 1e6))),
}


def pattern_of(path: tuple[int | str, ...]) -> str:
    """Return the key in `TYPICAL` of a place in the configuration: without indices, and with `*` for a
    name.
    """
    parts = [part for part in path if isinstance(part, str)]
    if parts[:1] in (["drivers"], ["boundary"]) and len(parts) > 1:
        parts[1] = "*"
    return ".".join(parts)


def hint(path: tuple[int | str, ...], value: object) -> str:
    """Return “; did you mean 0.04 (40 mm)?”, empty where the value is usual or no unit explains it.

    Args:
        path: Keys and indices of the value.
        value: Anything; only numbers get a hint.
    """
    candidates = _candidates(path, value)
    if not candidates:
        return ""
    return f"; did you mean {' or '.join(f'{v:g} ({value:g} {unit.shown})' for v, unit in candidates)}?"


def doubt(path: tuple[int | str, ...], value: float) -> str | None:
    """Return a sentence on a value outside its usual range, without its key; None for a usual value.

    A register that looks like a manual's number, such as 40001, is doubted too.
    """
    if str(path[-1]) in ("register", "status_register", "first_register") and (words := modicon(int(value))):
        return f"{value:g} {words}; leave it only if the manual counts on the wire"
    typical = TYPICAL.get(pattern_of(path))
    if typical is None or typical.holds(value):
        return None
    return f"{value:g} is far from the usual {typical.low:g} to {typical.high:g}" + (
        hint(path, value) or "; check its unit"
    )


def _candidates(path: tuple[int | str, ...], value: object) -> list[tuple[float, Unit]]:
    typical = TYPICAL.get(pattern_of(path))
    if typical is None or isinstance(value, bool) or not isinstance(value, int | float):
        return []
    if not -1e12 < value < 1e12 or typical.holds(value):
        return []
    return typical.meant(value)
