"""How well the machine is known: one standard deviation of all that is only roughly right."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from observer.tables.quantities import NonNegative, Section

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
