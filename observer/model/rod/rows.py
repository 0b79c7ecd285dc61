"""Output rows: temperature at a place, thermal error at a place, and what the dropped modes add to both.

For every input the steady field is known in closed form. What the kept modes leave of it is the static
correction: the output column of the input's lag (heats) or of the input itself (ambient, prescribed ends).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from observer.frames import FloatArray
from observer.model.rod.modes import Modes
from observer.model.rod.static import Stretch, quadrature
from observer.model.rod.supports import Restraint, restrained_rows

UM_PER_M = 1e6


class Places(NamedTuple):
    """Where the output rows stand: sensors (s,), grid (g,), the expansion coefficient of the error's rows,
    and what holds the screw (nothing: it grows freely from x = 0).
    """

    sensor_m: FloatArray
    grid_m: FloatArray
    expansion_1_K: float | None
    length_m: float
    restraint: Restraint | None = None

    @property
    def temperature_m(self) -> FloatArray:
        """Places of the rows that are temperatures: sensors, then grid."""
        return np.concatenate([self.sensor_m, self.grid_m])

    @property
    def growth_m(self) -> FloatArray:
        """Places to which growth is counted: the grid, then the screw's end."""
        return np.append(self.grid_m, self.length_m)

    @property
    def um_per_K_m(self) -> float:
        """Micrometres of growth per kelvin and metre."""
        return (self.expansion_1_K or 0.0) * UM_PER_M


def modal_rows(modes: Modes, places: Places) -> FloatArray:
    """Rows of the modal amplitudes, (R, N): θ_n(x), then α_T ∫_0^x θ_n dx of the free screw (Li 2022: E =
    α_T ∫(T − T_A)), less what the supports hold back.
    """
    temperature = modes.theta(places.temperature_m)
    if places.expansion_1_K is None:
        return temperature
    growth = places.um_per_K_m * modes.integral(np.zeros_like(places.growth_m), places.growth_m)
    return np.vstack([temperature, restrained_rows(places.restraint, growth)])


def remainder_rows(
    modes: Modes,
    places: Places,
    steady: Callable[[FloatArray], FloatArray],
    amplitude: FloatArray,
    kinks: Stretch | None = None,
    rows: FloatArray | None = None,
) -> FloatArray:
    """What the kept modes leave of one input's steady field, (R,).

    `steady(x)` is the closed form per unit of the input, `amplitude` (N,) the kept modes' steady share
    b_n/Λ_n, `rows` (R, N) those of the amplitudes where they are known already.
    """
    kept = (modal_rows(modes, places) if rows is None else rows) @ amplitude
    whole = steady(places.temperature_m)
    if places.expansion_1_K is not None:
        growth = places.um_per_K_m * _running_integral(modes, places.growth_m, steady, kinks)
        whole = np.concatenate([whole, restrained_rows(places.restraint, growth)])
    return np.asarray(whole - kept)


def reference_rows(places: Places) -> FloatArray:
    """The column (R,) of the thermal error's reference temperature: minus the growth per kelvin."""
    temperature = np.zeros(len(places.temperature_m))
    if places.expansion_1_K is None:
        return temperature
    growth = -places.um_per_K_m * places.growth_m
    return np.concatenate([temperature, restrained_rows(places.restraint, growth)])


def _running_integral(
    modes: Modes, grid_m: FloatArray, steady: Callable[[FloatArray], FloatArray], kinks: Stretch | None
) -> FloatArray:
    """∫_0^x of a steady field at each place, by Gauss panels that break at the grid and at its kinks."""
    breaks = [*grid_m.tolist(), *((kinks.a_m, kinks.b_m) if kinks else ())]
    nodes, weights = quadrature(modes.rod.length_m, breaks)
    running = np.concatenate([[0.0], np.cumsum(steady(nodes) * weights)])
    return np.asarray(running[np.searchsorted(nodes, grid_m)])
