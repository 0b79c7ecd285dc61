"""The configuration's tables of how heats and field are estimated, within which tolerances, how sensor faults
are found, and what is forecast.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from observer.tables.outside import is_outside, outside
from observer.tables.quantities import Flag, NonNegative, Number, Positive, Rise, Section

Learnable = Literal[
    "convection", "conductivity", "heat_capacity", "ambient_K", "end_W_K", "law", "offset_K", "position_m",
    "lag_s",
]  # fmt: skip
"""What an estimator may learn: the keys of `Tolerance`, and `law`, the scale of each heat's law."""

Relative = Annotated[NonNegative, Field(le=1)]


class Tolerance(Section):
    """One standard deviation of what is not known better; 0 takes the configuration's word for it.

    Relative: `conductivity`, `heat_capacity` (density times specific heat) and `convection` (of the base
    film). Of the measured or stated ambient `ambient_K`; of the loss of each end to the air beyond what the
    configuration says `end_W_K`; of each sensor on the screw where it sits, `position_m`, what it reads too
    much, `offset_K`, and how late, `lag_s`. A law's scale has its own, the source's `law_uncertainty`.

    Of logs, so in `discover`, `calibrate` and `identify`: by what part of its rise above the air each sensor
    reads too little or too much, `gain`; and, of several logs, by what part a source's heat differs from one
    to the next, `heat_per_log`.
    """

    conductivity: Relative = 0.03
    heat_capacity: Relative = 0.03
    convection: Relative = 0.30
    ambient_K: Annotated[NonNegative, Field(le=50)] = 0.5
    end_W_K: Annotated[NonNegative, Field(le=1000)] = 0.05
    position_m: Annotated[NonNegative, Field(le=1)] = 0.002
    offset_K: Annotated[NonNegative, Field(le=50)] = 0.3
    lag_s: Annotated[NonNegative, Field(le=1000)] = 4.0
    gain: Relative = 0.02
    heat_per_log: Relative = 0.03

    def offset_of_K(self, own_K: float | None) -> float:
        """Return the tolerance of a sensor's offset: its own where it says one."""
        return self.offset_K if own_K is None else own_K


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


class ForecastSettings(Section):
    """What is forecast, and how often; `within_um` is how near to where it settles counts as settled.

    Without `enabled` it is on where every estimated heat has a law.
    """

    enabled: Flag | None = None
    hours: Annotated[Positive, Field(ge=0.05, le=24)] = 1.0
    within_um: Annotated[Positive, Field(ge=0.01, le=1000)] = 2.0
    period_s: Annotated[Positive, Field(ge=5, le=3600)] = 60.0


class Integrity(Section):
    """How sensor faults are found: readings that no heat can explain are excluded before they correct.

    Only by the compiled Kalman filter; the other estimators refuse what lies beyond their gate.
    `fault_per_hour` is how likely a sensor fails unnoticed in an hour, `common_fault_per_hour` what all
    readings have in common: where it is likelier than 1e-5, bounds hold by laws and air alone.
    `drift_K_sqrt_h` is how far the offset of a reading, and what all have in common, may walk in an hour. An
    estimate is good only where no bound of the field is beyond `limit_K`, and none of the error beyond
    `limit_um`; without a limit the bounds are told, and do not matter.
    """

    enabled: Flag = True
    fault_per_hour: Annotated[NonNegative, Field(le=0.1)] = 1e-4
    common_fault_per_hour: Annotated[NonNegative, Field(le=0.1)] = 1e-5
    drift_K_sqrt_h: Annotated[NonNegative, Field(le=100.0)] = 0.3
    limit_K: Positive | None = None
    limit_um: Positive | None = None
