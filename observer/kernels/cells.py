"""Rows of decimal numbers, as the recorder writes them, read fast enough to look back over days."""

from __future__ import annotations

from observer.kernels.libc import NAN, cython, isnan

_COMMA, _NEWLINE, _PLUS, _MINUS, _POINT = 44, 10, 43, 45, 46  # as bytes
_ZERO, _NINE, _E, _SMALL_E = 48, 57, 69, 101
_FULL = 10**17
"""A digit more would not fit into 64 bits, and changes a number of double precision by a rounding at most."""
_FARTHEST = 400.0
"""A power of ten that is 0 or infinity."""


def read_rows(text, column, out):
    """Read the rows of `text` (bytes), a newline after each, into `out` (rows, k); return their number.

    Cell i of a row goes into column `column[i]` of `out`, or is ignored if that is -1. A cell without a valid
    number is NaN, and a row without exactly c cells is omitted. Numbers of up to 15 digits with a power of
    ten up to 22 equal Python's. Others differ by some roundings, and numbers below 1e-290 may be 0.
    """
    with cython.nogil:
        rows = _read(text, column, out)
    return rows  # noqa: RET504  (Python takes part again only here)


def _read(text, column, out):
    row = cell = begin = 0
    for at in range(len(text)):
        if text[at] != _COMMA and text[at] != _NEWLINE:
            continue
        if cell < column.shape[0] and column[cell] >= 0:
            out[row, column[cell]] = _number(text, begin, at)
        cell += 1
        begin = at + 1
        if text[at] == _NEWLINE:
            if cell == column.shape[0]:
                row += 1
            cell = 0
    return row


def _number(text, begin, end):
    """Return the number in the bytes from `begin` to `end`, NaN without a valid number."""
    at, sign, whole, power, digits, after = begin, 1.0, 0, 0, 0, 0
    if at < end and (text[at] == _PLUS or text[at] == _MINUS):
        sign = -1.0 if text[at] == _MINUS else 1.0
        at += 1
    while at < end and (_ZERO <= text[at] <= _NINE or (text[at] == _POINT and after == 0)):
        if text[at] == _POINT:
            after = 1
        else:
            digits += 1
            if whole < _FULL:
                whole = 10 * whole + (text[at] - _ZERO)
                power -= after
            else:
                power += 1 - after
        at += 1
    if digits == 0:
        return NAN
    exponent = 0.0
    if at < end:
        exponent = _exponent(text, at + 1, end) if text[at] == _E or text[at] == _SMALL_E else NAN
    return sign * _times_ten(whole, power + exponent)


def _exponent(text, begin, end):
    """Return the whole number in the bytes from `begin` to `end`, NaN without a valid one."""
    at, sign, value = begin, 1.0, 0.0
    if at < end and (text[at] == _PLUS or text[at] == _MINUS):
        sign = -1.0 if text[at] == _MINUS else 1.0
        at += 1
    if at == end:
        return NAN
    while at < end:
        if not _ZERO <= text[at] <= _NINE:
            return NAN
        value = 10.0 * value + (text[at] - _ZERO)
        at += 1
    return sign * value


def _times_ten(whole, power):
    """Return `whole` times ten to the `power`."""
    if whole == 0 or isnan(power):
        return NAN if isnan(power) else 0.0
    ten, left = 1.0, min(abs(power), _FARTHEST)
    while left >= 1.0:
        ten *= 10.0
        left -= 1.0
    return whole / ten if power < 0.0 else whole * ten
