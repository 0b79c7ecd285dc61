"""A telescopic cover, whose air a source warms."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from observer.config.effects import base
from observer.config.effects.base import EffectTable, Fitted, Target
from observer.config.effects.terms import Term, WarmedAir
from observer.config.quantities import Finite
from observer.config.sections import Description


class Cover(EffectTable):
    """Air under a cover: C dT_a/dt = heated q + ∫ h P (T − T_a) dx − loss (T_a − T_amb)."""

    target: Target  #: the source
    heated: Annotated[Finite, Field(ge=0, le=10)]  #: W into the air for each W into the screw
    loss_W_K: Annotated[Finite, Field(ge=0.01, le=1000)] = 20.0  #: from that air to the air outside, W/K
    capacity_J_K: Annotated[Finite, Field(ge=1, le=1e6)] = 500.0  #: heat capacity of air and cover, J/K

    parameters = {"heated": Fitted("1", 1.0)}
    targets = "source"
    missing_physics = "air under a cover that {target} warms"
    excitation = "half an hour of running, and a standstill with the screw warm"
    source = "energy balance of the air under the cover"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the air, along the whole screw."""
        at = base.named_source(machine, self.target, self.kind).name
        return (WarmedAir(at, 0.0, machine.screw.length_m, self.capacity_J_K, self.heated, self.loss_W_K),)
