"""Whether a series of samples is flat: the slope of its straight line, with what the scatter leaves open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Trend:
    """A quantity over the soak: its middle, its slope per hour with the standard error, and the limit."""

    name: str
    median: float
    slope_1_h: float
    sigma_1_h: float
    limit_1_h: float

    @property
    def flat(self) -> bool:
        """Whether it does not grow faster than the limit, as far as the samples show."""
        return self.slope_1_h - 2.0 * self.sigma_1_h <= self.limit_1_h

    def __str__(self) -> str:
        verdict = "flat" if self.flat else "GROWS"
        slope = f"{self.slope_1_h:+.3g} ± {self.sigma_1_h:.2g} per hour, limit {self.limit_1_h:g}"
        return f"{self.name:24} {self.median:10.4g}   {slope:44} {verdict}"


def trend(name: str, time_s: list[float], values: list[float], limit_1_h: float, blocks: int = 12) -> Trend:
    """Fit a line through the means of some blocks, so that neighbours that go together count once."""
    at_h = [part.mean() / 3600.0 for part in np.array_split(np.array(time_s), blocks)]
    means = np.array([part.mean() for part in np.array_split(np.array(values, float), blocks)])
    design = np.column_stack([np.ones(blocks), at_h])
    solution, *_ = np.linalg.lstsq(design, means)
    scatter = float(np.sum((means - design @ solution) ** 2)) / (blocks - 2)
    sigma = float(np.sqrt(scatter * np.linalg.inv(design.T @ design)[1, 1]))
    return Trend(name, float(np.median(values)), float(solution[1]), sigma, limit_1_h)
