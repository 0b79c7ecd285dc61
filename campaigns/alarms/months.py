"""Months of one source's heat, as the observer would estimate it: an own truth of friction, wear and seasons.

Nothing of the package makes these numbers. The friction of a bearing or nut is a load part and a viscous part
(Palmgren 1959): it falls as the grease warms, and grows with a power of speed that its law does not have. The
law is the configuration's straight line, off by a quarter. Errors of the estimate are drawn as the observer
shows them: alike for an hour or two, a tenth of the heat in size, more where the heat is small, and off with
the air of the season, whose film the configuration does not know.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from observer.quality.bands import WINDOW_S, Window

DAY_S = 86_400.0
MOST = 2.2  # what has worn so far is not run on
STIFF_S = 1800.0
ALIKE = float(np.exp(-WINDOW_S / 5400.0))


@dataclass(frozen=True)
class Story:
    """What happens to a source from `begins_h` hours of running on: wear doubles its heat in `doubles_h`, or
    preload is `lost`, a part of it, at once or in `loses_h`. `days` long.

    What is no fault: parts are machined at `slower` times the speed from then on, the machine stands for
    `rest_d` days; and each morning, from the first on, stiff grease makes `stiff` more heat, which fades in
    half an hour of running.
    """

    days: int = 120
    begins_h: float = 150.0
    doubles_h: float | None = None
    lost: float = 0.0
    loses_h: float = 0.0
    slower: float = 1.0
    rest_d: int = 0
    stiff: float = 0.0


@dataclass(frozen=True)
class Sample:
    """A window as the alarms get it, with the running hours behind it and the true factor of the heat."""

    window: Window
    running_h: float
    factor: float


def months(story: Story, seed: int) -> Iterator[Sample]:
    """Give the windows of running of one source over the days of a story."""
    rng = np.random.default_rng(seed)
    law_W_rpm = 0.006
    off, exponent = rng.uniform(0.75, 1.25), rng.uniform(0.8, 1.2)
    viscous_1_K, run_in, run_in_h = rng.uniform(0.004, 0.015), rng.uniform(0.0, 0.3), rng.uniform(2.0, 12.0)
    shifts, most_rpm = int(rng.integers(1, 4)), 3000.0
    season_K, phase = rng.uniform(2.0, 7.0), rng.uniform(0.0, 2.0 * np.pi)
    film_per_K, slow, running_h = rng.normal(0.0, 0.006), 0.0, 0.0
    parts_rpm = rng.uniform(400.0, most_rpm, size=8)
    rise_K, rests_d = 0.0, story.rest_d
    for day in range(story.days):
        rests = rests_d > 0 and running_h > story.begins_h
        rests_d -= rests
        if rests or (day % 7 >= 5 and shifts < 3):
            rise_K = 0.0
            continue
        if rng.uniform() < 0.1:  # other parts from here on
            parts_rpm = rng.uniform(400.0, most_rpm, size=8)
        air_K = season_K * np.sin(2.0 * np.pi * day / 90.0 + phase) + rng.normal(0.0, 1.0)
        part_rpm = float(rng.choice(parts_rpm))
        for k in range(int(shifts * 8 * 3600.0 / WINDOW_S)):
            if k % 12 == 0:
                part_rpm = float(rng.choice(parts_rpm))
            running_h += WINDOW_S / 3600.0
            factor = _factor(story, running_h)
            if factor > MOST:
                return
            at_rpm = part_rpm * (story.slower if running_h > story.begins_h else 1.0)
            speed = at_rpm / most_rpm
            friction = off * speed ** (exponent - 1.0) * (1.0 - viscous_1_K * (rise_K + air_K))
            friction *= 1.0 + run_in * np.exp(-running_h / run_in_h)
            friction *= 1.0 + story.stiff * np.exp(-k * WINDOW_S / STIFF_S)
            law_W = law_W_rpm * at_rpm
            heat_W = law_W * friction * factor
            rise_K += (0.6 * heat_W - rise_K) * (1.0 - np.exp(-WINDOW_S / 5400.0))
            slow = ALIKE * slow + np.sqrt(1.0 - ALIKE**2) * rng.normal()
            error = 0.1 * slow + film_per_K * air_K * rise_K / max(heat_W, 1.0) + 0.3 * rng.normal() / law_W
            time_s = 1.7e9 + day * DAY_S + 6 * 3600.0 + (k + 1) * WINDOW_S
            estimated_W = heat_W * (1.0 + error)
            window = Window(
                time_s, estimated_W, 0.1 * estimated_W + 0.2, law_W, rise_K + rng.normal(0.0, 0.3), law_W
            )
            yield Sample(window, running_h, factor)


def _factor(story: Story, running_h: float) -> float:
    """What has become of the heat: it grows by itself, as wear does, or falls."""
    since_h = running_h - story.begins_h
    if since_h <= 0.0:
        return 1.0
    grown = 1.0 if story.doubles_h is None else 2.0 ** (since_h / story.doubles_h)
    return grown * (1.0 - story.lost * min(since_h / story.loses_h if story.loses_h else 1.0, 1.0))
