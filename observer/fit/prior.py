"""Knowledge of parameters before a calibration: how far each may be off, and its physical range.

A sensor on a housing hardly shows the film of the screw. Without this knowledge a fit may give such a
parameter any value that explains a little noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.fit.parameters import PARAMETERS, bounds_of, get
from observer.fit.tolerance import TOLERANCE_OF, tolerances_of_parts
from observer.frames import FloatArray

LEAST_SHARE = 0.1
"""Least prior standard deviation, relative, of films, conductances and friction. An earlier calibration may
have written a smaller tolerance, and a machine changes: covers, grease, preload.
"""


FRICTION_TIMES = 5.0
"""Ratio of the prior σ of friction to `law_uncertainty`: a log of work shows friction well."""


class PhysicalRange(NamedTuple):
    """The physical range of a kind of parameter in a calibration.

    Attributes:
        low: Lower end.
        high: Upper end.
        source: Where the range comes from.
        relative: Whether both ends are multiples of the configured value. Otherwise they have the parameter's
            unit.
    """

    low: float
    high: float
    source: str
    relative: bool = True


PHYSICAL: dict[str, PhysicalRange] = {
    "surface.convection_W_m2K": PhysicalRange(
        2.0, 250.0, "free to forced convection of gases, Incropera et al. 2007, table 1.1", relative=False
    ),
    "surface.factor": PhysicalRange(
        0.2, 5.0, "film laws hold within a quarter on smooth cylinders; threads and covers add"
    ),
    "boundary.coefficient_W_m2K": PhysicalRange(
        0.1, 10.0, "contacts in air span a decade either way, Incropera et al. 2007, table 3.1"
    ),
    "screw.diameter_m": PhysicalRange(0.9, 1.1, "root to outer diameter of a ball screw"),
    "screw.conductivity_W_mK": PhysicalRange(0.6, 1.6, "heat treatment and alloy within one class of steel"),
    "screw.density_kg_m3": PhysicalRange(0.9, 1.1, "alloys within one class of steel"),
    "screw.specific_heat_J_kgK": PhysicalRange(0.85, 1.2, "alloys within one class of steel, 0 to 100 °C"),
    "screw.expansion_1_K": PhysicalRange(0.8, 1.25, "alloys within one class of steel"),
    "bed.expansion_1_K": PhysicalRange(0.5, 2.0, "from mineral casting to steel"),
    "source.torque_Nm": PhysicalRange(0.1, 10.0, "friction of one nut with new to run-in grease and preload"),
    "source.heat_W_rpm": PhysicalRange(0.1, 10.0, "friction of one bearing with new to run-in grease"),
    "source.scale": PhysicalRange(0.1, 10.0, "as the friction that it multiplies"),
    "node.capacity_J_K": PhysicalRange(0.25, 4.0, "mass by estimate, with what is bolted to the body"),
    "link.factor": PhysicalRange(0.1, 10.0, "contacts span a decade either way, as boundary"),
}
"""By the first part of the key and its last; others keep the range of `parameters`."""


class Prior(NamedTuple):
    """Knowledge of f free parameters before a fit, in their units.

    Attributes:
        sigma: Standard deviation about the configured value, (f,), infinite where nothing is stated.
        low: Lower end of the range, (f,).
        high: Upper end, (f,).
    """

    sigma: FloatArray
    low: FloatArray
    high: FloatArray


def prior_of(config: Config, keys: Sequence[str]) -> Prior:
    """Return what a configuration states of free parameters.

    Args:
        config: The configuration, whose values are the means of the prior.
        keys: The free parameters, f of them.

    Returns:
        σ and ranges. The configured value is always within the range. A value of 0 has no σ.
    """
    shares = relative_tolerances(config)
    values = [get(config, key) for key in keys]
    sigma = [shares.get(key, 0.0) * abs(value) or np.inf for key, value in zip(keys, values, strict=True)]
    low, high = np.array([range_of(config, key) for key in keys]).reshape(-1, 2).T
    return Prior(np.array(sigma), low, high)


def relative_tolerances(config: Config) -> Mapping[str, float]:
    """Return the relative σ of each parameter with a tolerance, by its key.

    Films, conductances and friction have at least `LEAST_SHARE`, friction five times the uncertainty of its
    law.
    """
    tolerance = config.tolerance
    changing = {key: share for key, _, share in tolerances_of_parts(config) if not key.startswith("node.")}
    changing |= dict.fromkeys(TOLERANCE_OF["convection"], tolerance.convection)
    for source in config.source:
        keys = (f"source.{source.name}.{last}" for last in PARAMETERS["source"])
        changing |= dict.fromkeys(keys, FRICTION_TIMES * config.law_uncertainty(source))
    lasting = {key: share for key, _, share in tolerances_of_parts(config) if key.startswith("node.")}
    for name in ("conductivity", "heat_capacity"):
        lasting |= dict.fromkeys(TOLERANCE_OF[name], getattr(tolerance, name))
    return lasting | {key: max(share, LEAST_SHARE) for key, share in changing.items() if share > 0.0}


def range_of(config: Config, key: str) -> tuple[float, float]:
    """Return lower and upper end of a parameter in a calibration, in its unit.

    It is the part of the physical range within the bounds of a fit, widened to include the configured value.
    """
    low, high = bounds_of(config, key)
    physical, value = physical_of(key), get(config, key)
    if physical is None:
        return low, high
    unit = abs(value) if physical.relative else 1.0
    if unit == 0.0:  # a range relative to nothing
        return low, high
    return max(low, min(physical.low * unit, value)), min(high, max(physical.high * unit, value))


def physical_of(key: str) -> PhysicalRange | None:
    """Return the physical range of a parameter by its key, or None where none is stated."""
    first, *_, last = key.split(".")
    return PHYSICAL.get(f"{first}.{last}")
