"""The same axis with thermocouples where most machines have them: on the nut and on both bearings' housings.

Each is a body of one temperature on the screw's seat: C dT/dt = q + G (T_screw − T) + G_air (T_air − T). Half
of the nut's friction heats its body. The nut passes heat to each place under it separately. Seats and losses
differ by a tenth or two from the demo's configuration, as real dimensions do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivers.simulated.machine import NOISE_K, FloatArray, ScrewData, SimulatedMachine, TrueHeats

SENSORS = ("nut_body_degC", "left_housing_degC", "right_housing_degC")
SHARE_OF_BODY = 0.5


@dataclass(frozen=True, slots=True)
class Bodies:
    """Nut, left and right housing: what they store, pass to the screw and lose to the air, (3,) each.

    Attributes:
        capacity_J_K: Heat capacities in J/K.
        seat_W_K: Conductances to the screw in W/K.
        air_W_K: Conductances to the air in W/K.
    """

    capacity_J_K: tuple[float, ...] = (600.0, 1500.0, 1500.0)
    seat_W_K: tuple[float, ...] = (9.2, 8.6, 11.3)
    air_W_K: tuple[float, ...] = (0.55, 0.9, 1.1)


class HousedMachine(SimulatedMachine):
    """The axis with three bodies beside its screw, and no thermocouple on it.

    The bodies advance by explicit Euler steps, which is stable for steps far below C / (G + G_air).
    """

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        bodies = Bodies()
        self._capacity_J_K, self._seat_W_K = np.array(bodies.capacity_J_K), np.array(bodies.seat_W_K)
        self._air_W_K, self._air_degC = np.array(bodies.air_W_K), ScrewData().ambient_degC
        self._body_degC = np.full(3, self._air_degC)

    def heats(self) -> TrueHeats:
        """Return the present true heats; the nut's includes the heat into its body."""
        true = super().heats()
        return replace(true, nut_W=true.nut_W / (1.0 - SHARE_OF_BODY))

    def thermocouples_degC(self) -> dict[str, float]:
        """Return the present readings of the thermocouples in °C, each with its own noise."""
        noisy = self._body_degC + NOISE_K * self._random.standard_normal(len(SENSORS))
        return dict(zip(SENSORS, noisy.tolist(), strict=True))

    def _entering_W(self, true: TrueHeats, nut_shares: FloatArray, dt_s: float) -> FloatArray:
        """Return the heat into each cell (cells,) in W, with that from the bodies, and advance the bodies by
        `dt_s`.
        """
        q_W = super()._entering_W(replace(true, nut_W=(1.0 - SHARE_OF_BODY) * true.nut_W), nut_shares, dt_s)
        screw_degC, (nut_degC, *housings_degC) = self._screw.temperature_degC, self._body_degC
        passed_W = self._seat_W_K[0] * nut_shares * (nut_degC - screw_degC)
        ends_W = self._seat_W_K[1:] * (housings_degC - screw_degC[[0, -1]])
        q_W += passed_W
        q_W[[0, -1]] += ends_W
        gained_W = np.array([SHARE_OF_BODY * true.nut_W - passed_W.sum(), *-ends_W])
        gained_W += self._air_W_K * (self._air_degC - self._body_degC)
        self._body_degC = self._body_degC + dt_s * gained_W / self._capacity_J_K
        return q_W
