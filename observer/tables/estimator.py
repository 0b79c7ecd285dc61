"""The configuration's table of how heats and field are estimated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from observer.tables.quantities import NonNegative, Number, Positive, Rise, Section


class EstimatorSettings(Section):
    """How heats and field are estimated."""

    kind: Literal["kalman", "luenberger"] = "kalman"
    period_s: Annotated[Number, Field(ge=0.001, le=3600)] = 0.5
    # Kalman
    engine: Literal["compiled", "filterpy", "constant"] = "compiled"
    gate_sigma: Annotated[Positive, Field(ge=0.1)] = 5.0
    initial_sigma_K: Rise = 2.0
    field_noise_K_sqrt_s: Annotated[NonNegative, Field(le=1000)] = 0.002
    # Luenberger
    pole_rule: Literal["bandwidth", "kim"] = "bandwidth"
    bandwidth_1_s: Annotated[Positive, Field(ge=1e-9, le=1e4)] | None = None
