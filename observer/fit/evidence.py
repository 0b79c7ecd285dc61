"""The measurements, split into folds and weighted: the measured side of every hypothesis.

Each log is averaged over half minutes. The last log, or the end of a single one, is the proof: it takes no
part in fitting or choosing. The others are folds for cross-validation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.fit.steps import SteppedRun
from observer.frames import FloatArray

PROOF, UNUSED = -1, -2
FITTED_SHARE, MARGIN_SHARE = 0.62, 0.08
"""Part of a single log that is fitted, and part left out between that and the proof."""
SLOW_S, SLOW_K, SLOW_SHARE = 900.0, 0.006, 0.0015
"""Form error of a one-dimensional model: correlation time, standard deviation, and its share of the sensor's
rms rise.
"""
BEAT_S, BEAT_K, BEAT_SHARE = 90.0, 0.003, 0.0006
"""The same for the beat between a nut's motion and the sampling of its position."""
GROWTH_SHARE = 0.01
"""The slow form error of a displacement as a share of its rms rise: no frame is straight."""
TRUSTED, LEAST_SAMPLES = 3.0, 200
LEFT_OF_STEP, LEAST_K = 0.29, 0.003
"""Error of a half-minute mean due to the resolution of a log: 1/√12 of a step, and its least value, K."""
LOW_QUANTILE, MOSTLY, ENOUGH = 0.1, 0.9, 8
"""Values are quantised if most of their differences are multiples of a low quantile of these.

The numbers are that quantile, the required share, and the least number of differences.
"""


@dataclass(frozen=True)
class Evidence:
    """The means of all runs, one row per mean and sensor that was measured; n rows.

    Attributes:
        run: Number of the run, (n,).
        mean: Number of the mean within the run, (n,).
        sensor: Number of the sensor, (n,).
        measured_degC: Measured mean, °C, or µm of a displacement, (n,).
        noise_K: σ of its white noise, K or µm, (n,).
        time_s: End of the mean since the start of its run, s, (n,).
        fold: `PROOF`, `UNUSED`, or the number of a fold from 0, (n,).
        groups: Rows of one run, sensor and role in order of time, each with the matrix L⁻¹ that whitens them.
    """

    run: NDArray[np.int64]
    mean: NDArray[np.int64]
    sensor: NDArray[np.int64]
    measured_degC: FloatArray
    noise_K: FloatArray
    time_s: FloatArray
    fold: NDArray[np.int64]
    groups: tuple[tuple[NDArray[np.int64], FloatArray], ...]

    def rows(self, means: Sequence[FloatArray]) -> FloatArray:
        """Return the rows (n, …) of values that are given mean by mean.

        Args:
            means: Values of each run, (b, s, …), for its b means and s sensors.
        """
        out = np.empty((len(self.run), *means[0].shape[2:]))
        for i, values in enumerate(means):
            of_run = self.run == i
            out[of_run] = values[self.mean[of_run], self.sensor[of_run]]
        return out

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Return columns whitened: errors of a correct model have variance 1 and are uncorrelated in time.

        Args:
            columns: Values of all rows, (n,) or (n, c), in K, or µm for displacements.
        """
        out = (columns.T / self.noise_K).T  # rows outside all groups are white
        for index, matrix in self.groups:
            out[index] = matrix @ columns[index]
        return out

    @cached_property
    def expected(self) -> float:
        """Mean square of the whitened error of a perfect model, from white noise alone; below 1."""
        total = sum(float(np.sum((matrix * self.noise_K[index]) ** 2)) for index, matrix in self.groups)
        return total / max(len(self.run), 1)

    @cached_property
    def deviation_K(self) -> FloatArray:
        """σ of every row, K or µm, (n,): white noise, slow form error and beat."""
        out = self.noise_K.copy()
        for index, matrix in self.groups:
            out[index] = np.linalg.norm(np.linalg.inv(matrix), axis=1)
        return out

    @property
    def folds(self) -> int:
        """Number of folds for cross-validation; the proof is not one of them."""
        return int(self.fold.max()) + 1

    @property
    def used(self) -> NDArray[np.bool_]:
        """True for the rows that may be fitted and chosen on, (n,)."""
        return np.asarray(self.fold >= 0)

    @property
    def proof(self) -> NDArray[np.bool_]:
        """True for the rows of the proof, (n,)."""
        return np.asarray(self.fold == PROOF)


def even(runs: Sequence[SteppedRun], noise_K: FloatArray) -> Evidence:
    """Return the evidence of runs that are all fitted, in one fold and with white noise only.

    Means with few values are left out.

    Args:
        runs: The runs.
        noise_K: σ of one sample of each sensor, K or µm, (s,). A mean has σ/√count.
    """
    parts = []
    for i, run in enumerate(runs):
        mean, sensor = np.nonzero(_full(run.ticks.count))
        measured, count = run.ticks.measured_degC[mean, sensor], run.ticks.count[mean, sensor]
        parts.append((np.full(len(mean), i), mean, sensor, measured, run.ticks.time_s[mean], count))
    run_, mean, sensor, measured, time_s, count = (np.concatenate(p) for p in zip(*parts, strict=True))
    white_K = noise_K[sensor] / np.sqrt(count)
    return Evidence(run_, mean, sensor, measured, white_K, time_s, np.zeros_like(run_), ())


def gather(
    runs: Sequence[SteppedRun],
    noise_K: FloatArray,
    *,
    proves: bool = True,
    slow_share: FloatArray | None = None,
) -> Evidence:
    """Return the evidence of one or more runs, with folds and correlated errors.

    The covariance of the rows of one group is white noise, slow form error and beat: diag(w) + a²
    exp(−|Δt|/900 s) + b² exp(−|Δt|/90 s). The amplitudes a and b grow with the rise of the sensor. White
    noise includes the resolution of the log.

    Args:
        runs: The runs.
        noise_K: Configured σ of one sample of each sensor, K or µm, (s,); the logs correct it within a factor
            of 3.
        proves: Whether a part is held back as the proof. Without, all rows are one fold.
        slow_share: Slow form error of each sensor as a share of its rise, (s,). None takes `SLOW_SHARE`.
    """
    slow_share = np.full(len(noise_K), SLOW_SHARE) if slow_share is None else slow_share
    noise_K = shown_noise(runs, noise_K)
    rows = even(runs, noise_K)
    ends_s = [run.ticks.time_s[-1] for run in runs]
    folds = [_folds(rows.time_s[rows.run == i], end_s, i, len(runs)) for i, end_s in enumerate(ends_s)]
    run, sensor, fold = rows.run, rows.sensor, np.concatenate(folds) if proves else rows.fold
    rise_K = _rises(run, sensor, rows.measured_degC, fold)
    left_K = np.maximum(LEFT_OF_STEP * resolution(runs, len(noise_K)), LEAST_K)
    white_K = np.sqrt(rows.noise_K**2 + left_K[sensor] ** 2)
    groups = []
    for i, s in np.ndindex(len(runs), len(noise_K)):
        for role in np.unique(fold[(run == i) & (sensor == s)]):
            index = np.flatnonzero((run == i) & (sensor == s) & (fold == role))
            slow_K = SLOW_K + float(slow_share[s] * rise_K[i, s])
            beat_K = BEAT_K + BEAT_SHARE * float(rise_K[i, s])
            groups.append((index, _whitening(rows.time_s[index], white_K[index] ** 2, slow_K, beat_K)))
    return replace(rows, noise_K=white_K, fold=fold, groups=tuple(groups))


def shown_noise(runs: Sequence[SteppedRun], noise_K: FloatArray) -> FloatArray:
    """Return the noise that the logs show from sample to sample, K or µm, (s,); the proof is not used.

    σ² is half of the mean square of the differences, which are limited to six configured σ.

    Args:
        runs: The runs. A sensor with fewer than 200 differences keeps its configured noise.
        noise_K: Configured σ, K or µm, (s,). The result is within a factor `TRUSTED` of it.
    """
    out = noise_K.copy()
    fitted = [r.run for r in (runs[:-1] if len(runs) > 1 else runs)]
    share = FITTED_SHARE if len(runs) == 1 else 1.0
    early = [r.frames.time_s - r.frames.time_s[0] <= share * r.duration_s for r in fitted]
    for s in range(len(noise_K)):
        steps = [np.diff(r.values_degC[e & r.usable[:, s], s]) for r, e in zip(fitted, early, strict=True)]
        step_K = np.concatenate(steps)
        if len(step_K) >= LEAST_SAMPLES:
            shown_K = float(np.sqrt(np.mean(np.clip(step_K, -6 * noise_K[s], 6 * noise_K[s]) ** 2) / 2))
            out[s] = min(max(shown_K, noise_K[s] / TRUSTED), noise_K[s] * TRUSTED)
    return out


def resolution(runs: Sequence[SteppedRun], sensors: int) -> FloatArray:
    """Return the sensors' resolution in the logs, K or µm, (s,); 0 where none is visible.

    Args:
        runs: The runs, whose values count together.
        sensors: Number s of sensors.
    """
    out = np.zeros(sensors)
    for s in range(sensors):
        values = np.concatenate([r.run.values_degC[r.run.usable[:, s], s] for r in runs])
        apart = np.diff(np.unique(np.round(values, 6)))
        if len(apart) >= ENOUGH and (step := np.quantile(apart, LOW_QUANTILE)) > 0.0:
            whole = apart / step
            out[s] = step if np.mean(np.abs(whole - np.rint(whole)) < 0.02) > MOSTLY else 0.0
    return out


def _full(count: FloatArray) -> NDArray[np.bool_]:
    """Which means (b, s) have at least half of the median number of values, or of the most that a sensor has
    which comes rarely.
    """
    usual = np.median(count[count > 0]) if (count > 0).any() else 1.0
    most = np.maximum(count.max(axis=0, initial=0.0), 1.0)
    return np.asarray(count >= 0.5 * np.minimum(usual, most))


def _folds(time_s: FloatArray, end_s: float, run: int, runs: int) -> NDArray[np.int64]:
    """The folds of one run's rows: whole runs if there are several, otherwise parts with a margin."""
    if runs >= 3:
        return np.full(len(time_s), PROOF if run == runs - 1 else run)
    if runs == 2:
        return np.full(len(time_s), PROOF) if run else np.where(time_s < end_s / 2, 0, 1)
    begin = FITTED_SHARE * end_s
    fold = np.where(time_s < begin / 2, 0, 1)
    fold = np.where(time_s > begin, UNUSED, fold)
    return np.where(time_s > begin + MARGIN_SHARE * end_s, PROOF, fold)


def _rises(
    run: NDArray[np.int64], sensor: NDArray[np.int64], measured: FloatArray, fold: NDArray[np.int64]
) -> FloatArray:
    """How far each sensor rises over the start of each run, rms, (runs, s), K; the proof is not used."""
    out = np.zeros((int(run.max()) + 1, int(sensor.max()) + 1))
    for i, s in np.ndindex(out.shape):
        whole = (run == i) & (sensor == s)
        fitted = whole & (fold >= 0)
        values = measured[fitted if fitted.any() else whole]
        if len(values):
            out[i, s] = np.sqrt(np.mean((values - values[0]) ** 2))
    return out


def _whitening(time_s: FloatArray, white_K2: FloatArray, slow_K: float, beat_K: float) -> FloatArray:
    """L⁻¹ with L Lᵀ = diag(white) + slow² exp(−|Δt|/τ_slow) + beat² exp(−|Δt|/τ_beat)."""
    from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

    apart_s = np.abs(time_s[:, None] - time_s)
    covariance = np.diag(white_K2) + slow_K**2 * np.exp(-apart_s / SLOW_S)
    covariance += beat_K**2 * np.exp(-apart_s / BEAT_S)
    lower = np.linalg.cholesky(covariance)
    return np.asarray(solve_triangular(lower, np.eye(len(lower)), lower=True))
