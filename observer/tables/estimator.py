"""The configuration's table of how heats and field are estimated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from observer.tables.outside import is_outside, outside
from observer.tables.quantities import NonNegative, Number, Positive, Rise, Section
from observer.tables.tolerance import Learnable

_KINDS = ("kalman", "luenberger")


def _known(kind: str) -> str:
    if is_outside(kind):
        outside(kind)
    elif kind not in _KINDS:
        raise ValueError(f'unknown kind {kind[:60]!r}; give one of {", ".join(_KINDS)}, or "module:Class"')
    return kind


class EstimatorSettings(Section):
    """How heats and field are estimated.

    `learn` is what the compiled Kalman filter finds out while it runs; the rest of what `[tolerance]` knows
    only roughly it allows for.
    """

    kind: Annotated[str, AfterValidator(_known)] = "kalman"
    period_s: Annotated[Number, Field(ge=0.001, le=3600)] = 0.5
    # Kalman
    engine: Literal["compiled", "filterpy", "constant"] = "compiled"
    gate_sigma: Annotated[Positive, Field(ge=0.1)] = 5.0
    initial_sigma_K: Rise = 2.0
    field_noise_K_sqrt_s: Annotated[NonNegative, Field(le=1000)] = 0.002
    learn: Annotated[tuple[Learnable, ...], Field(max_length=20)] = ("convection", "offset_K")
    # Luenberger
    pole_rule: Literal["bandwidth", "kim"] = "bandwidth"
    bandwidth_1_s: Annotated[Positive, Field(ge=1e-9, le=1e4)] | None = None

    @property
    def allows(self) -> bool:
        """Whether the estimator is one whose σ hold what tolerances cost."""
        return self.kind == "luenberger" or (self.kind == "kalman" and self.engine != "filterpy")

    @property
    def learnt(self) -> tuple[str, ...]:
        """What is learnt; nothing by an estimator with a gain that knows of heats and field alone."""
        return self.learn if self.learns else ()

    @property
    def learns(self) -> bool:
        """Whether the estimator is one that takes tolerances into its state."""
        return self.kind == "kalman" and self.engine == "compiled"

    @property
    def screens(self) -> bool:
        """Whether the estimator is one that can screen readings, and bound what their faults do to it."""
        return self.kind == "kalman" and self.engine == "compiled"
