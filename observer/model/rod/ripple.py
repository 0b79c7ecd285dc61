"""What sensors see of a nut that sweeps over its stroke again and again, beyond its mean columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray
from observer.model.rod.moving import NutTable, columns_at

_PLACES = 64
PHASES = 8
"""At how many phases of a sweep the readings are told apart."""


class Sweep(NamedTuple):
    """A nut that runs to and fro between two places, m, at a speed, m/s; at none it stands in the middle."""

    low_m: float
    high_m: float
    speed_m_s: float

    @property
    def middle_m(self) -> float:
        """Where it stands."""
        return 0.5 * (self.low_m + self.high_m)


class Ripple(NamedTuple):
    """Of each sensor, at so many phases of a sweep, (f, s), per W of the nut's heat: how much more than in
    the mean it reads, `seen`, K/W, and what its place, K/(W m), and its lag, K/(W s), add to that.
    """

    seen: FloatArray
    by_place: FloatArray
    by_lag: FloatArray


def ripple(
    table: NutTable,
    sweep: Sweep,
    decay_1_s: FloatArray,
    C: FloatArray,
    slope_C: FloatArray,
    lag_s: FloatArray,
) -> Ripple:
    """Return what sensors see of a sweep in the periodic steady state, by Fourier's series.

    `decay_1_s` (N,) of the modes, `C` and `slope_C` (s, N) the sensors' rows of T, and of ∂T/∂x, by them;
    `lag_s` (s,). Each mode answers a harmonic by 1/(λ + iω), the column of the lag by g/(g + iω).
    """
    N, s = len(decay_1_s), len(C)
    way = np.abs((np.arange(_PLACES) + 0.5) / (_PLACES / 2) - 1.0)
    places = [columns_at(table, [x]) for x in (sweep.low_m + (sweep.high_m - sweep.low_m) * way).tolist()]
    B, of_lag = np.array([b[:N] for b, _ in places]), np.array([c[:s] for _, c in places])
    round_s = 2.0 * (sweep.high_m - sweep.low_m) / sweep.speed_m_s
    i_omega = 2j * np.pi * np.fft.rfftfreq(_PLACES, round_s / _PLACES)[1:, None]
    modes = np.fft.rfft(B, axis=0)[1:] / (decay_1_s + i_omega)
    dropped = np.fft.rfft(of_lag, axis=0)[1:] * table.lag_decay_1_s / (table.lag_decay_1_s + i_omega)
    seen = modes @ C.T + dropped
    lagging = seen * (-i_omega / (1.0 + i_omega * lag_s))

    def over_phases(harmonics: NDArray[np.complex128]) -> FloatArray:
        whole = np.fft.irfft(np.vstack([np.zeros((1, s)), harmonics]), _PLACES, axis=0)
        return np.asarray(whole.reshape(PHASES, -1, s).mean(axis=1))

    return Ripple(over_phases(seen), over_phases(modes @ slope_C.T), over_phases(lagging))
