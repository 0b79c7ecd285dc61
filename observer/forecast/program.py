"""The program of a machine: learnt from its last minutes in coarse bins, or given, and repeated.

A bin holds the means of the plant's inputs over some seconds; the input column of a nut is weighted with its
heat. A cycle is found by the autocorrelation of the heat by law (Box and Jenkins 1976, eq. 2.1.12). Work
without a cycle is represented by its mean, with the spread of its blocks about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.frames import EstimateBlock, FloatArray, Inputs

BIN_S = 10.0
"""How long a bin is: shorter cycles are averaged over, as every screw does."""
WINDOW_BINS = 540
"""How many bins are remembered: three cycles of half an hour."""
FEWEST = 6
"""A program can be recognised from a minute on, not from less."""
_LAST = 30  # five minutes are what runs now
_EVEN = 0.1  # bins that differ by no more of their mean are one level
_ALIKE = 0.6  # an autocorrelation above this is a cycle
_IDLE_W = 1e-3
_LONG_REST = 45
_BLOCK = 30
_CHANGES_S, _PRIOR = 250.0, 4.0  # for how long mixed work stays alike, and how firmly that is believed

ProgramKind = Literal["cycle", "mixed", "given", "standstill"]


class Bins(NamedTuple):
    """b bins in order of time, of m sources, m_e of them estimated, p known inputs, M moving sources.

    Attributes:
        dt_s: Length of each bin, s, (b,).
        law_W: Heats by their laws, W, (b, m).
        z: Known inputs, °C, (b, p).
        loss_1_s: Rate of a uniform loss, 1/s, (b,).
        loss_degC: Temperature that it draws to, °C, (b,).
        moving_B: Input columns of moving sources, (b, M, n_x).
        moving_C: Output columns of their lags, (b, M, R).
        heat_W: Estimated heats, W, (b, m_e), NaN without an estimate.
        sigma_W: Their σ, W, (b, m_e).
        own_law_W: The same heats by their laws, W, (b, m_e).
    """

    dt_s: FloatArray
    law_W: FloatArray
    z: FloatArray
    loss_1_s: FloatArray
    loss_degC: FloatArray
    moving_B: FloatArray
    moving_C: FloatArray
    heat_W: FloatArray
    sigma_W: FloatArray
    own_law_W: FloatArray

    @property
    def total_W(self) -> FloatArray:
        """Magnitude of the heat of all sources by their laws, W, (b,)."""
        return np.asarray(np.abs(self.law_W).sum(axis=1))

    def at(self, index: slice | NDArray[Any]) -> Bins:
        """Return some of the bins, by a slice or by their numbers."""
        return Bins(*(column[index] for column in self))


@dataclass(frozen=True, slots=True)
class Program:
    """A program, repeated for ever.

    Attributes:
        kind: Cycle, mixed work, a given program, or standstill.
        period_s: Length of one repetition, s; None if `bins` are a mean.
        text: Description for people.
        bins: The inputs that are repeated.
        past: The bins from which it was learnt, the last ones of the actual operation.
        noise_W2_s: Spectral density, at low frequency, of the total heat about the program, W² s.
    """

    kind: ProgramKind
    period_s: float | None
    text: str
    bins: Bins
    past: Bins
    noise_W2_s: float

    @property
    def is_even(self) -> bool:
        """Whether it is work at one level: a cycle without a period."""
        return self.kind == "cycle" and self.period_s is None

    @property
    def mean(self) -> Bins:
        """One bin with the means of all."""
        return averaged(self.bins)


def binned(inputs: Inputs, estimates: EstimateBlock | None, moving: Sequence[int]) -> Bins:
    """Return steps averaged over bins of `BIN_S`, the last of which may be short.

    Steps of no length and steps with unknown inputs are left out. A longer step counts as one bin.

    Args:
        inputs: K steps.
        estimates: Their estimates. None leaves those columns NaN, m wide.
        moving: Numbers of the moving sources, by whose heat their columns are weighted, (M,).
    """
    complete = (
        (inputs.dt_s > 0.0) & np.isfinite(inputs.law_W).all(axis=1) & np.isfinite(inputs.z_end).all(axis=1)
    )
    complete &= np.isfinite(inputs.moving_B).all(axis=(1, 2)) & np.isfinite(inputs.moving_C).all(axis=(1, 2))
    at = np.flatnonzero(complete)
    if not len(at):
        return _bins_of(inputs, estimates, at, np.zeros(0, np.int64), moving)
    dt_s = np.minimum(inputs.dt_s[at], BIN_S)
    label = np.floor((np.cumsum(dt_s) - 1e-9) / BIN_S).astype(np.int64)
    return _bins_of(inputs, estimates, at, np.flatnonzero(np.diff(label, prepend=-1)), moving)


def _bins_of(
    u: Inputs,
    estimates: EstimateBlock | None,
    at: NDArray[Any],
    first: NDArray[Any],
    moving: Sequence[int],
) -> Bins:
    weight = np.minimum(u.dt_s[at], BIN_S)

    def total(rows: FloatArray) -> FloatArray:
        return np.add.reduceat(rows, first, axis=0) if len(first) else rows[:0]

    dt_s = total(weight)

    def mean(rows: FloatArray) -> FloatArray:
        by = (-1, *(1,) * (rows.ndim - 1))
        return np.asarray(total(rows[at] * weight.reshape(by)) / dt_s.reshape(by))

    heated = np.abs(u.law_W[:, list(moving)])[:, :, None] + 1e-9  # at rest, where the nut is
    unknown = np.full((len(u), u.law_W.shape[1]), np.nan)
    heats = (
        (unknown,) * 3 if estimates is None else (estimates.heat_W, estimates.heat_sigma_W, estimates.law_W)
    )
    loss_1_s = mean(u.loss_1_s)
    return Bins(
        dt_s, mean(u.law_W), mean(u.z_end), loss_1_s,
        mean(u.loss_1_s * u.loss_degC) / np.where(loss_1_s > 0.0, loss_1_s, 1.0),
        mean(u.moving_B * heated) / mean(heated), mean(u.moving_C * heated) / mean(heated), *map(mean, heats),
    )  # fmt: skip


def joined(parts: Sequence[Bins]) -> Bins:
    """Return consecutive bins as one, the last `WINDOW_BINS` of them."""
    return Bins(*(np.concatenate(column)[-WINDOW_BINS:] for column in zip(*parts, strict=True)))


def averaged(bins: Bins) -> Bins:
    """Return one bin with the means of all; the columns of the nuts are weighted with the total heat."""
    w, heat = bins.dt_s, bins.dt_s * (bins.total_W + 1e-9)
    plain = [np.tensordot(w, column, 1) / w.sum() for column in bins[1:5]]
    nuts = [np.tensordot(heat, column, 1) / heat.sum() for column in bins[5:7]]
    rest = [np.tensordot(w, column, 1) / w.sum() for column in bins[7:]]
    return Bins(*(np.asarray(c)[None] for c in (w.mean(), *plain, *nuts, *rest)))


def learnt(bins: Bins) -> Program:
    """Return the program that the last bins show.

    It is a standstill after five minutes without heat, work at one level, a cycle, or else mixed work. Bins
    before the last long rest do not count.

    Args:
        bins: Bins of the actual operation.

    Raises:
        ValueError: If they cover less than a minute.
    """
    if len(bins.dt_s) < FEWEST:
        raise ValueError("the program is not known yet; wait for a minute of operation")
    total_W = bins.total_W
    if total_W[-_LAST:].max() <= _IDLE_W and period_bins(total_W) is None:
        now = bins.at(slice(-_LAST, None))
        return Program("standstill", None, "the machine stands", averaged(now), now, 0.0)
    bins = bins.at(slice(_since_rest(total_W), None))
    total_W = bins.total_W
    if (even := _even(total_W)) is not None:
        now = bins.at(slice(even, None))
        text = f"runs evenly, {averaged(now).total_W[0]:.3g} W by the laws"
        return Program("cycle", None, text, averaged(now), now, noise_W2_s(now))
    if (period := period_bins(total_W)) is not None:
        text = f"a cycle of {period * BIN_S / 60:.3g} min"
        return Program(
            "cycle", period * BIN_S, text, _one_cycle(bins, period), bins, noise_W2_s(bins, period)
        )
    text = f"mixed work, {averaged(bins).total_W[0]:.3g} W in the mean by the laws"
    return Program("mixed", None, text, averaged(bins), bins, noise_W2_s(bins))


def repeating(bins: Bins, past: Bins) -> Program:
    """Return a given program, repeated.

    Args:
        bins: Its bins.
        past: The last bins of the actual operation, which give the present heats.

    Raises:
        ValueError: If `past` covers less than a minute.
    """
    if len(past.dt_s) < FEWEST:
        raise ValueError("the heats are not known yet; wait for a minute of operation")
    whole_s = float(bins.dt_s.sum())
    return Program("given", whole_s, f"the program that is given, {whole_s / 60:.3g} min", bins, past, 0.0)


def _since_rest(total_W: FloatArray) -> int:
    """Return the bin where work begins after the last rest of more than seven minutes."""
    idle, run, begin = total_W <= _IDLE_W, 0, 0
    if period_bins(total_W) is not None:
        return 0
    for i, is_idle in enumerate(idle):
        run = run + 1 if is_idle else 0
        if run > _LONG_REST:
            begin = i + 1
    return min(begin, len(total_W) - 1)


def _even(total_W: FloatArray) -> int | None:
    """Return the bin from which the heat has been at one level; None if that is less than five minutes."""
    level = float(np.median(total_W[-_LAST:]))
    uneven_bins = np.flatnonzero(np.abs(total_W - level) > _EVEN * level)
    begin = int(uneven_bins[-1]) + 1 if len(uneven_bins) else 0
    length = len(total_W) - begin
    short = length < min(_LAST, len(total_W)) or (length < 6 * _LAST and 2 * length < len(total_W))
    if short or period_bins(total_W) is not None:
        return None
    return begin


def period_bins(total_W: FloatArray) -> int | None:
    """Return the period of the heat in bins.

    It is the shortest lag whose autocorrelation is a peak above 0.6 and within 10 % of the highest one.

    Args:
        total_W: Heat in each bin, W, (b,).

    Returns:
        The period, or None if it does not occur two and a half times.
    """
    n = len(total_W)
    deviation_W = total_W - total_W.mean()
    scale = float(deviation_W @ deviation_W)
    if n < 10 or scale <= (_EVEN * max(total_W.mean(), _IDLE_W)) ** 2 * n / 4:
        return None
    lags = np.arange(1, int(n / 2.5) + 1)
    correlation = np.array([float(deviation_W[k:] @ deviation_W[:-k]) / scale * n / (n - k) for k in lags])
    peak = np.flatnonzero((correlation[1:-1] >= correlation[:-2]) & (correlation[1:-1] > correlation[2:])) + 1
    crossed = np.flatnonzero(correlation < 0.2)
    peak = peak[(correlation[peak] > _ALIKE) & (peak > (crossed[0] if len(crossed) else n))]
    if not len(peak):
        return None
    return int(lags[peak[correlation[peak] >= 0.9 * correlation[peak].max()][0]])


def _one_cycle(bins: Bins, period: int) -> Bins:
    """Return one cycle that continues where the bins end, each bin the mean over all whole cycles."""
    begin = len(bins.dt_s) % period
    means = [averaged(bins.at(slice(begin + i, None, period))) for i in range(period)]
    return joined(means)._replace(dt_s=np.full(period, BIN_S))


def noise_W2_s(bins: Bins, period: int | None = None) -> float:
    """Return the spectral density of the total heat about its mean at low frequency, in W² s.

    It gives the difference between the mean of an hour and that of the past. For mixed work, which is not
    white, it is the variance times the integrated correlation. For cycles, whose times vary too, it is T var
    of means over T. T is whole cycles of about fifteen minutes (Welch 1967, with rectangular windows).

    Args:
        bins: Bins of the actual operation.
        period: Period of a cycle in bins, or None. A cycle needs two blocks of about fifteen minutes, else
            the result is 0.
    """
    if period is None:
        return _integrated_W2_s(bins.total_W)
    block = period * max(1, round(3 * _BLOCK / period))
    count = len(bins.dt_s) // block
    if count < 2:
        return 0.0
    means = bins.total_W[-count * block :].reshape(count, block).mean(axis=1)
    return float(block * BIN_S * means.var(ddof=1))


def _integrated_W2_s(total_W: FloatArray) -> float:
    """Return the variance times the integrated correlation, ∑ ρ dt, in W² s.

    The sum ends where neighbours' sums are no longer positive (Geyer 1992, section 3.3), and the mean's own
    variance is added. A prior of `_CHANGES_S` counts less the longer the series is.
    """
    n = len(total_W)
    deviation_W = total_W - total_W.mean()
    spectrum = np.abs(np.fft.rfft(deviation_W, 2 * n)) ** 2
    autocovariance = np.fft.irfft(spectrum)[:n] / n
    if autocovariance[0] <= 0.0:
        return 0.0
    pairs = autocovariance[1 : n - (n - 1) % 2].reshape(-1, 2).sum(axis=1)[: n // 4]
    ends = np.flatnonzero(pairs <= 0.0)
    correlated_s = BIN_S * (1.0 + 2.0 * pairs[: ends[0] if len(ends) else None].sum() / autocovariance[0])
    correlated_s /= 1.0 - min(correlated_s / (n * BIN_S), 0.5)
    observed = n / _BLOCK / 1.5
    return float(autocovariance[0] * (_PRIOR * _CHANGES_S + observed * correlated_s) / (_PRIOR + observed))
