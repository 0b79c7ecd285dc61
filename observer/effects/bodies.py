"""Effects of what the screw touches: conduction into a bearing's housing, and bodies that store heat."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from observer.effects.base import EffectTable, Target, free_end, source_free_to_warm
from observer.effects.terms import Body, End, EndConductance, Heat, Term
from observer.tables.quantities import Finite
from observer.tables.sections import Description, Source


class EndConduction(EffectTable):
    """Heat into a bearing or its housing, which stay at ambient temperature: G (T − T_amb) at an end."""

    kind: Literal["end_conduction"]
    target: End
    conductance_W_K: Annotated[Finite, Field(ge=0, le=1000)]

    parameters = ("conductance_W_K",)
    targets = "end"
    excitation = "a warm screw, and a sensor near the end"
    source = "Newton's law at the end face; Kim et al., the convective end"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        free_end(machine, self.target, self.kind)
        return (EndConductance(self.target, self.conductance_W_K),)


class AttachedMass(EffectTable):
    """A body that stores heat, at an end or at a source (with a nut it moves): C dT_b/dt = G (T − T_b)."""

    kind: Literal["attached_mass"]
    target: Target
    capacity_J_K: Annotated[Finite, Field(ge=1, le=1e6)]
    conductance_W_K: Annotated[Finite, Field(ge=1e-3, le=1000)]

    parameters = ("capacity_J_K", "conductance_W_K")
    targets = "place"
    excitation = "heating and cooling that are fast against the body's time constant"
    source = "a lumped capacity; Li 2022, network nodes"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        if self.target not in ("left", "right"):
            at = source_free_to_warm(machine, self.target, self.kind)
            return (Body(at, self.capacity_J_K, self.conductance_W_K),)
        place = Source(
            name=f"{self.kind}.{self.target}",
            shape="point",
            position_m=free_end(machine, self.target, self.kind),
            heat_W=0.0,
            estimate=False,
            initial_sigma_W=1.0,
        )
        return (Heat(place), Body(place.name, self.capacity_J_K, self.conductance_W_K))
