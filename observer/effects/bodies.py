"""Effects of what the screw touches: conduction into a bearing's housing, and bodies that store heat."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from observer.effects import base
from observer.effects.base import EffectTable, Fitted, Shape, Target
from observer.effects.families import BODY, END_LOSS, HEAT_LOSS
from observer.effects.terms import Body, End, EndConductance, Term
from observer.tables.quantities import Finite
from observer.tables.sections import Description

MOST_CAPACITY_J_K = 2e4
"""Forty kilograms of steel; a body that stores more hardly warms, and is a loss."""


class EndConduction(EffectTable):
    """Heat into a bearing or its housing, which stay at ambient temperature: G (T − T_amb) at an end."""

    kind: Literal["end_conduction"]
    target: End
    conductance_W_K: Annotated[Finite, Field(ge=0, le=1000)]

    parameters = {"conductance_W_K": Fitted("W/K", 0.05)}
    targets = "end"
    families = (END_LOSS, HEAT_LOSS)
    lacks = "heat that flows into the housing at {target}"
    excitation = "a warm screw, and a sensor near the end"
    source = "Newton's law at the end face; Kim et al., the convective end"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        base.free_end(machine, self.target, self.kind)
        return (EndConductance(self.target, self.conductance_W_K),)


class AttachedMass(EffectTable):
    """A body that stores heat, at an end or at a source (with a nut it moves): C dT_b/dt = G (T − T_b)."""

    kind: Literal["attached_mass"]
    target: Target
    capacity_J_K: Annotated[Finite, Field(ge=1, le=1e6)]
    conductance_W_K: Annotated[Finite, Field(ge=1e-3, le=1000)]

    parameters = {
        "capacity_J_K": Fitted("J/K", 1000.0, high=MOST_CAPACITY_J_K, bounded=True),
        "conductance_W_K": Fitted("W/K", 2.0),
    }
    targets = "place"
    families = (BODY, END_LOSS)
    lacks = "a body that stores heat at {target}"
    excitation = "heating and cooling that are fast against the body's time constant"
    source = "a lumped capacity; Li 2022, network nodes"

    @classmethod
    def shapes(cls, machine: Description) -> Sequence[Shape]:
        """Bodies by time constant and by how much of their heat the screw feels."""
        pairs = ((100.0, 3.0), (500.0, 1.0), (2000.0, 5.0), (4000.0, 1.0))
        return [{"capacity_J_K": C, "conductance_W_K": G} for C, G in pairs]

    def terms(self, machine: Description) -> tuple[Term, ...]:
        if self.target not in ("left", "right"):
            at = base.source_free_to_warm(machine, self.target, self.kind)
            return (Body(at, self.capacity_J_K, self.conductance_W_K),)
        name, end_m = f"{self.kind}.{self.target}", base.free_end(machine, self.target, self.kind)
        body = Body(name, self.capacity_J_K, self.conductance_W_K)
        return (base.point_heat(name, end_m, heat_W=0.0), body)
