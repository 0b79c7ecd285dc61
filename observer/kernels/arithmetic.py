"""Small arithmetic that C has not, or not as Python."""

from __future__ import annotations

from observer.kernels.libm import fmod


def squared(value):
    """value²; a power would be rounded twice."""
    return value * value


def sign(value):
    """−1, 0 or 1."""
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else value


def remainder(value, period):
    """What is left of a value after whole periods, from 0 up to one."""
    left = fmod(value, period)
    return left + period if left < 0.0 else left
