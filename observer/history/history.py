"""What every method of `observer identify` returns: the heats over a whole log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from observer.frames import FloatArray


@dataclass(frozen=True, slots=True)
class HeatHistory:
    """The estimated heats at K steps, each from all measurements of the log, before and after it.

    Shapes, with m_e estimated sources and s sensors: `heat_W`, `heat_sigma_W` (K, m_e), NaN where nothing is
    known; `residual_K` (K, s), measured minus explained temperature, NaN where no value was used. `details`
    says how the method went, in names and numbers; `warnings` are sentences.
    """

    time_s: FloatArray
    heat_W: FloatArray
    heat_sigma_W: FloatArray
    residual_K: FloatArray
    details: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.time_s)
