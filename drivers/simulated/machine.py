"""The axis that the simulated machine runs: speed programme, nut, friction, screw and thermocouples.

Its friction deviates from the nominal heat law, so that an estimator has something to find. Every source is
about a tenth off, and the nut's drifts slowly. The screw conducts by finite volumes, implicit in time:

C_i dT_i/dt = G (T_{i-1} − 2 T_i + T_{i+1}) + H (T_amb − T_i) + q_i.

The ends are insulated. C = ρ c A Δx, G = k A / Δx, H = h P Δx. Backward Euler gives a symmetric positive
definite tridiagonal system (Patankar 1980, chapter 4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

FloatArray = NDArray[np.float64]

LEAD_M = 0.010
NUT_LENGTH_M = 0.08
STROKE_M = (0.15, 0.80)
SENSORS = {"t1_degC": 0.05, "t2_degC": 0.28, "t3_degC": 0.50, "t4_degC": 0.72, "t5_degC": 0.95}
NOISE_K = 0.05
EXPANSION_1_K, PROBE_NOISE_UM = 11.8e-6, 0.3
PROGRAMME = ((240.0, 1500.0), (40.0, 0.0), (150.0, 2500.0), (40.0, 0.0), (100.0, 800.0))  # s, rpm

NOMINAL_TORQUE_NM = 0.30
NOMINAL_SHARE = 0.5
NOMINAL_BEARING_W_RPM = 0.006


@dataclass(frozen=True, slots=True)
class ScrewData:
    """Geometry, material and surroundings of the screw.

    Attributes:
        length_m: Length in m.
        diameter_m: Effective diameter in m, from which cross-section and surface follow.
        conductivity_W_mK: Thermal conductivity in W/(m K).
        density_kg_m3: Density in kg/m³.
        specific_heat_J_kgK: Specific heat in J/(kg K).
        film_W_m2K: Film coefficient of the whole surface in W/(m² K).
        ambient_degC: Temperature of the air, and of the screw at the start, in °C.
        cells: How many finite volumes of equal length.
    """

    length_m: float = 1.0
    diameter_m: float = 0.036
    conductivity_W_mK: float = 50.0
    density_kg_m3: float = 7800.0
    specific_heat_J_kgK: float = 460.0
    film_W_m2K: float = 15.0
    ambient_degC: float = 22.0
    cells: int = 250


class FiniteVolumeScrew:
    """The temperature of every cell (cells,) in °C, advanced in steps.

    Attributes:
        rod: The data that it was made from.
        temperature_degC: The present temperature at the centre of each cell, from the left end on.
    """

    def __init__(self, rod: ScrewData) -> None:
        self.rod = rod
        self._dx_m = rod.length_m / rod.cells
        self._edges_m = np.linspace(0.0, rod.length_m, rod.cells + 1)
        self._centres_m = 0.5 * (self._edges_m[1:] + self._edges_m[:-1])
        area_m2 = math.pi * rod.diameter_m**2 / 4
        self._capacity_J_K = rod.density_kg_m3 * rod.specific_heat_J_kgK * area_m2 * self._dx_m
        self._conductance_W_K = rod.conductivity_W_mK * area_m2 / self._dx_m
        self._film_W_K = rod.film_W_m2K * math.pi * rod.diameter_m * self._dx_m
        neighbours = np.full(rod.cells, 2.0)
        neighbours[[0, -1]] = 1.0
        self._steady_W_K = self._film_W_K + neighbours * self._conductance_W_K
        self._off_W_K = np.full(rod.cells - 1, -self._conductance_W_K)
        self.temperature_degC = np.full(rod.cells, rod.ambient_degC)

    def step(self, dt_s: float, heat_W: FloatArray) -> None:
        """Advance by one implicit step.

        Backward Euler (Patankar 1980, chapter 4) is stable for any step; the tridiagonal system is solved by
        LAPACK's `dptsv`.

        Args:
            dt_s: Length of the step in s, above 0.
            heat_W: Heat into each cell (cells,) in W, constant over the step.
        """
        stored_W_K = self._capacity_J_K / dt_s
        right = stored_W_K * self.temperature_degC + self._film_W_K * self.rod.ambient_degC + heat_W
        _, _, self.temperature_degC, _ = lapack.dptsv(stored_W_K + self._steady_W_K, self._off_W_K, right)

    def spread(self, from_m: float, to_m: float) -> FloatArray:
        """Return the share of each cell (cells,) in a heat that is uniform over a stretch.

        Args:
            from_m: Start of the stretch in m from the left end.
            to_m: Its end, beyond `from_m`.

        Returns:
            Shares that sum to 1 if the stretch lies on the screw.
        """
        overlap_m = np.minimum(self._edges_m[1:], to_m) - np.maximum(self._edges_m[:-1], from_m)
        share: FloatArray = np.clip(overlap_m, 0.0, None) / (to_m - from_m)
        return share

    def at(self, position_m: FloatArray) -> FloatArray:
        """Return temperatures (k,) in °C at positions (k,) in m from the left end.

        They are interpolated between cell centres, and constant within half a cell of each end.
        """
        temperature_degC: FloatArray = np.interp(position_m, self._centres_m, self.temperature_degC)
        return temperature_degC

    def rise_K_m(self, to_m: float) -> float:
        """Return the integral of the temperature above ambient from 0 to `to_m`, in K m.

        Times the expansion coefficient it is the screw's growth up to there, in m.
        """
        inside_m = np.clip(to_m - self._edges_m[:-1], 0.0, self._dx_m)
        return float(inside_m @ (self.temperature_degC - self.rod.ambient_degC))


@dataclass(frozen=True, slots=True)
class TrueHeats:
    """The true heats entering the screw.

    Attributes:
        nut_W: Friction of the nut, in W; with housings, the part into its body included.
        left_bearing_W: Friction of the left bearing, in W.
        right_bearing_W: Friction of the right bearing, in W.
    """

    nut_W: float
    left_bearing_W: float
    right_bearing_W: float


def speed_rpm(time_s: float) -> float:
    """Return the speed that the programme, repeated for ever, commands.

    Args:
        time_s: The machine's time in s; 0 is the start of the programme.
    """
    remaining_s = time_s % sum(duration_s for duration_s, _ in PROGRAMME)
    for duration_s, speed in PROGRAMME:
        if remaining_s < duration_s:
            return speed
        remaining_s -= duration_s
    return PROGRAMME[-1][1]


def heats(time_s: float) -> TrueHeats:
    """Return the true heats at a time in s of the machine.

    They are torque · share · ω in the nut and W per rpm in the bearings. Each deviates from its nominal
    value: the nut by 10 ± 4 % with a period of 900 s, the bearings by 12 and −10 %.
    """
    speed = speed_rpm(time_s)
    torque_Nm = NOMINAL_TORQUE_NM * (1.10 + 0.04 * math.sin(2 * math.pi * time_s / 900.0))
    return TrueHeats(
        nut_W=NOMINAL_SHARE * torque_Nm * speed * math.pi / 30,
        left_bearing_W=1.12 * NOMINAL_BEARING_W_RPM * speed,
        right_bearing_W=0.90 * NOMINAL_BEARING_W_RPM * speed,
    )


class SimulatedMachine:
    """The axis in its own time, which starts at 0 with a cold screw.

    It has no clock: `advance` moves it, faster or slower than real time.

    Args:
        seed: Of the sensors' noise, so that a run can be repeated.

    Attributes:
        time_s: The machine's time in s.
    """

    def __init__(self, seed: int) -> None:
        self.time_s = 0.0
        self._screw = FiniteVolumeScrew(ScrewData())
        self._travel_m = 0.0
        self._random = np.random.default_rng(seed)
        self._positions_m = np.array(list(SENSORS.values()))

    def heats(self) -> TrueHeats:
        """Return the present true heats.

        In the demo it is published as `truth/heat`, beside the estimates.
        """
        return heats(self.time_s)

    def advance(self, dt_s: float) -> None:
        """Move and heat for one step of `dt_s`.

        Half of the nut's heat goes to the nut's position at the start of the step, half to that at its end.
        """
        true, nut_shares = self.heats(), 0.5 * self._under_nut()
        self._travel_m += LEAD_M * speed_rpm(self.time_s) / 60 * dt_s
        nut_shares += 0.5 * self._under_nut()
        self._screw.step(dt_s, self._entering_W(true, nut_shares, dt_s))
        self.time_s += dt_s

    def nut_position_m(self, ahead_s: float = 0.0) -> float:
        """Return the position of the nut's centre in m from the left end; it goes back and forth over the
        stroke.

        Args:
            ahead_s: How long after the machine's present time, in s, at the present speed.
        """
        low_m = STROKE_M[0] + NUT_LENGTH_M / 2
        reach_m = STROKE_M[1] - STROKE_M[0] - NUT_LENGTH_M
        travel_m = self._travel_m + LEAD_M * speed_rpm(self.time_s) / 60 * ahead_s
        phase_m = travel_m % (2 * reach_m)
        return low_m + (phase_m if phase_m <= reach_m else 2 * reach_m - phase_m)

    def thermocouples_degC(self) -> dict[str, float]:
        """Return the present readings of the thermocouples in °C by name.

        Each call draws new noise, with a standard deviation of 0.05 K for each of them.
        """
        noisy = self._screw.at(self._positions_m) + NOISE_K * self._random.standard_normal(len(SENSORS))
        return dict(zip(SENSORS, noisy.tolist(), strict=True))

    def probed_um(self, position_m: float) -> float:
        """Return a probe's reading of the screw's growth at a position in µm.

        It is relative to a screw as warm as the air, and has a noise of 0.3 µm.

        Args:
            position_m: The place in m from the left end, which is fixed.
        """
        grown_um = 1e6 * EXPANSION_1_K * self._screw.rise_K_m(position_m)
        return grown_um + PROBE_NOISE_UM * float(self._random.standard_normal())

    def _entering_W(self, true: TrueHeats, nut_shares: FloatArray, _dt_s: float) -> FloatArray:
        """Return the heat into each cell (cells,) in W; `nut_shares` (cells,) is each cell's share in the
        nut's heat.
        """
        q_W = true.nut_W * nut_shares
        q_W[0] += true.left_bearing_W
        q_W[-1] += true.right_bearing_W
        return q_W

    def _under_nut(self) -> FloatArray:
        centre_m = self.nut_position_m()
        return self._screw.spread(centre_m - NUT_LENGTH_M / 2, centre_m + NUT_LENGTH_M / 2)
