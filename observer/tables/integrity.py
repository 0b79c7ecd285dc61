"""The configuration's table of how sensor faults are found."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from observer.tables.quantities import Flag, NonNegative, Positive, Section


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
