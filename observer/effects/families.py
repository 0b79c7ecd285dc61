"""Families: effects that are the same to a log in all but their name, and the one figure that they share.

A film, radiation and a film that turning adds all take heat from the surface. Where a log cannot tell which
of them it is, it still tells how much heat goes: as much as a film of so many W/m²K would take.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Family:
    """What effects have in common, and the figure that says how strong any of them is in effect.

    `lacks` is what a model without any of them lacks, `{target}` being the place where `placed` asks for one
    that all share. The figure `key` in `unit` is the heat that an effect takes out of the screw, by least
    squares against how much warmer than the air the screw is: all over its `surface`, at the `end`, or on
    average over the `screw`; or the mean heat that it brings over `time`; or, as its `own`, its parameter of
    that name.
    """

    name: str
    lacks: str
    key: str
    unit: str
    against: Literal["surface", "end", "screw", "time", "own"]
    placed: bool = False


END_LOSS = Family("end_loss", "a loss of heat at {target}", "conductance_W_K", "W/K", "end", placed=True)
SURFACE_LOSS = Family(
    "surface_loss", "a loss of heat from the surface", "coefficient_W_m2K", "W/m2K", "surface"
)
HEAT_LOSS = Family("heat_loss", "a loss of heat", "conductance_W_K", "W/K", "screw")
END_SOURCE = Family("end_source", "heat at {target}", "heat_W", "W", "time", placed=True)
BODY = Family("body", "a body that stores heat", "capacity_J_K", "J/K", "own")
FAMILIES = {f.name: f for f in (END_LOSS, SURFACE_LOSS, HEAT_LOSS, END_SOURCE, BODY)}
