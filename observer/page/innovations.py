"""The last innovation of each sensor. A sensor that reads less often than the estimator steps has none at
most steps, and a viewer is not sent every step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_LATE = 1.5
"""A reading is late when the one before is older than so many times what lay between the last two."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """What a sensor last said against the model, at which step, and how long after the one before."""

    value_K: float
    sigma_K: float
    time_s: float
    sequence: int
    after_s: float


class Innovations:
    """Takes every estimate, decoded."""

    def __init__(self) -> None:
        self._last: dict[str, Innovation] = {}
        self._instance: str | None = None

    def take(self, estimate: Mapping[str, Any]) -> None:
        """Keep what is known; another instance of the service, or a clock that went back, begins anew."""
        time_s, instance = estimate["time_s"], estimate.get("instance")
        if instance != self._instance or any(time_s < last.time_s for last in self._last.values()):
            self._last, self._instance = {}, instance
        columns = (estimate.get(key, ()) for key in ("sensors", "innovation_K", "innovation_sigma_K"))
        for name, value_K, sigma_K in zip(*columns, strict=False):
            if not math.isfinite(value_K):
                continue
            before = self._last.get(name)
            after_s = 0.0 if before is None else time_s - before.time_s
            self._last[name] = Innovation(
                float(value_K), float(sigma_K), time_s, estimate["sequence"], after_s
            )

    def document(self, time_s: float) -> dict[str, dict[str, Any]]:
        """By sensor `{"value", "sigma", "sequence", "age_s", "late"}`, as it is at a time."""
        return {
            name: {
                "value": round(last.value_K, 6),
                "sigma": round(last.sigma_K, 6) if math.isfinite(last.sigma_K) else None,
                "sequence": last.sequence,
                "age_s": round(time_s - last.time_s, 3),
                "late": time_s - last.time_s > _LATE * last.after_s,
            }
            for name, last in self._last.items()
        }
