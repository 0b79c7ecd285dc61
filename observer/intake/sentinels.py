"""Numbers that stand for a missing value: overload of a meter, a sensor that is absent or not ready."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from observer.config.logs import Logs
from observer.files.log_checks import Words
from observer.files.logs import Log
from observer.frames import BoolArray, FloatArray
from observer.intake.units import known_unit, split_name
from observer.units import BY_NAME, ZERO_DEGC_K

OVERLOAD = 9e36
"""Meters write 9.9E+37 for an overload and 9.91E+37 for no value; no quantity of a machine is so large."""
_OF_SENSORS_DEGC = (85.0, -127.0)
"""A DS18B20 that has not measured yet, and one that does not answer."""
_LEAST_STEP_K, _OF_USUAL = 5.0, 20.0
"""How far such a value is from the values beside it, in K and in usual steps between values."""


def without_sentinels(
    values: FloatArray, name: str, unit: str, missing: Sequence[str] = ()
) -> tuple[FloatArray, list[Words]]:
    """Return values with NaN for each sentinel, and how many of each there were.

    Sentinels are overloads of meters, temperatures below absolute zero, and the 85 °C and −127 °C of a
    DS18B20. The latter two count only where they stand apart from the values beside them.

    Args:
        values: Values (n,) as recorded.
        name: The channel, for the counts.
        unit: Unit of the values, as `known_unit` gives it.
        missing: Texts of `[log] missing`; those that are numbers are sentinels too.
    """
    is_sentinel = np.abs(values) >= OVERLOAD
    for number in _numbers(missing):
        is_sentinel |= np.isclose(values, number, rtol=1e-6, atol=0.0) | (values == number)
    if unit in ("degC", "degF", "kelvin"):
        degC = BY_NAME[unit].to_base(np.where(is_sentinel, np.nan, values))
        is_sentinel |= degC < -ZERO_DEGC_K
        degC[is_sentinel] = np.nan
        for code_degC in _OF_SENSORS_DEGC:
            is_sentinel |= _stands_apart(degC, code_degC)
    if not is_sentinel.any():
        return values, []
    sentinels, counts = np.unique(values[is_sentinel], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    words = tuple(f"{sentinels[i]:.6g}" for i in order)
    return np.where(is_sentinel, np.nan, values), [Words(name, int(counts.sum()), words)]


def _numbers(texts: Iterable[str]) -> list[float]:
    numbers = []
    for text in texts:
        try:
            numbers.append(float(text.replace(",", ".")))
        except ValueError:
            continue
    return [number for number in numbers if np.isfinite(number)]


def _stands_apart(degC: FloatArray, code_degC: float) -> BoolArray:
    """Return where temperatures (n,) are exactly a code, and no value beside them leads there."""
    is_code = np.abs(degC - code_degC) < 1e-6
    others = np.flatnonzero(np.isfinite(degC) & ~is_code)
    if not is_code.any() or not len(others):
        return np.zeros(len(degC), bool)
    usual_K = float(np.median(np.abs(np.diff(degC[others])))) if len(others) > 1 else 0.0
    at = np.flatnonzero(is_code)
    after = np.searchsorted(others, at)
    before_degC = np.where(after > 0, degC[others[np.maximum(after - 1, 0)]], np.nan)
    after_degC = np.where(after < len(others), degC[others[np.minimum(after, len(others) - 1)]], np.nan)
    nearest_K = np.fmin(np.abs(before_degC - code_degC), np.abs(after_degC - code_degC))
    apart = np.zeros(len(degC), bool)
    apart[at] = nearest_K > max(_LEAST_STEP_K, _OF_USUAL * usual_K)
    return apart


def cleaned(log: Log, options: Logs) -> Log:
    """Return a log in the program's own form without sentinels; a recording is returned unchanged.

    A recording of the service has passed its drivers, which mark missing values.
    """
    if log.step is not None:
        return log
    values, words = log.values.copy(), list(log.words)
    for j, name in enumerate(log.channels):
        values[:, j], missing = without_sentinels(
            values[:, j], name, known_unit(split_name(name)[1]), options.missing
        )
        words += missing
    return replace(log, values=values, words=tuple(words)) if len(words) > len(log.words) else log
