"""Which free parameters a log can tell, and in words why not the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.fit.parameters import FILM
from observer.fit.runs import Run
from observer.frames import FloatArray
from observer.tables.sections import law_channels

SEEN_SIGMA = 3.0
"""A change by its natural scale must move some 30 s mean by this many standard deviations of its noise."""
APART = 0.01
"""Sine of the angle below which one parameter's effect counts as a mixture of others'."""


class Obstacle(NamedTuple):
    """A free parameter that the logs cannot tell: why, and what to do about it."""

    key: str
    reason: str
    remedy: str


def describe(obstacle: Obstacle) -> str:
    """Return an obstacle as a sentence."""
    return f"{obstacle.key}: {obstacle.reason}; {obstacle.remedy}."


def distinguishable(
    config: Config, keys: tuple[str, ...], jacobian: FloatArray, runs: Sequence[Run]
) -> tuple[tuple[str, ...], tuple[Obstacle, ...]]:
    """Split the free parameters into those the logs tell and the others.

    `jacobian` (n, p) is in standard deviations per natural scale. A parameter is told if its effect is seen
    at all and is not a mixture of the effects of those before it in the configuration (Gram-Schmidt on
    angles, so that a parameter's size does not matter).
    """
    basis: list[FloatArray] = []
    told: list[str] = []
    obstacles: list[Obstacle] = []
    for key, column in zip(keys, jacobian.T, strict=True):
        if float(np.max(np.abs(column))) < SEEN_SIGMA:
            obstacles.append(_unseen(config, key, runs))
            continue
        rest = column / float(np.linalg.norm(column))
        for q in basis * 2:  # twice is enough (Giraud, Langou & Rozložník 2005)
            rest = rest - q * float(q @ rest)
        if float(np.linalg.norm(rest)) < APART:
            obstacles.append(_mixed(key, column, told, jacobian[:, [keys.index(k) for k in told]]))
            continue
        basis.append(rest / float(np.linalg.norm(rest)))
        told.append(key)
    return tuple(told), tuple(obstacles)


def _mixed(key: str, column: FloatArray, told: Sequence[str], others: FloatArray) -> Obstacle:
    """The obstacle of a parameter whose effect others can make up; they are named by their shares."""
    share = np.linalg.lstsq(others, column)[0] * np.linalg.norm(others, axis=0) / np.linalg.norm(column)
    partners = [k for k, s in zip(told, np.abs(share), strict=True) if s > 0.1]
    fewer = "one of the two" if len(partners) == 1 else "some of them"
    return Obstacle(
        key, f"its effect on the sensors is that of {' and '.join(partners)}", f"free only {fewer}"
    )


def _unseen(config: Config, key: str, runs: Sequence[Run]) -> Obstacle:
    """The obstacle of a parameter that moves no sensor."""
    if key.startswith("source."):
        source = next(s for s in config.source if key.startswith(f"source.{s.name}."))
        channels = law_channels(source, config.source)
        if channels and not any(_moves(run, channel) for run in runs for channel in channels):
            channel = channels[0]
            return Obstacle(
                key, f"{channel} stays at 0 in these logs", f"add a run in which {channel} is not 0"
            )
        return Obstacle(key, "its heat reaches no sensor", "add a run with more heat, or a sensor nearer by")
    if key == FILM:
        return Obstacle(
            key,
            f"the screw stays within {max(map(_swing_K, runs)):.1f} K of its start",
            "add a run that warms the screw up and lets it cool",
        )
    return Obstacle(key, "it moves no sensor in these logs", "take it out of [calibrate] free")


def _moves(run: Run, channel: str) -> bool:
    values = run.frames.values[:, run.frames.channels.index(channel)]
    return bool(np.nanmax(np.abs(values), initial=0.0) > 0)


def _swing_K(run: Run) -> float:
    return float(np.nanmax(np.abs(run.measured_degC - run.start_degC), initial=0.0))
