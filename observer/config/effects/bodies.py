"""Effects of bodies that touch the screw: conduction into a bearing's housing, and bodies that store heat."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Annotated, Literal

from pydantic import Field

from observer.config.effects import base
from observer.config.effects.base import BODY, END_LOSS, HEAT_LOSS, EffectTable, Fitted, Form, Shape, Target
from observer.config.effects.terms import Body, End, EndConductance, LawScale, Term
from observer.config.laws import DIVIDED_LAWS
from observer.config.quantities import Finite, NonNegative, Share
from observer.config.screw import Screw
from observer.config.sections import Description, Source
from observer.errors import ConfigError

LEAST_SHARE = 0.01
"""Of a friction's heat that enters the screw: with less the rest cannot be computed from it."""
MOST_CAPACITY_J_K = 2e4
"""Forty kilograms of steel; a body that stores more hardly warms, and is a loss."""


class EndConduction(EffectTable):
    """Heat into a bearing or its housing, which stay at ambient temperature: G (T − T_amb) at an end."""

    kind: Literal["end_conduction"]
    target: End  #: `left` or `right`
    conductance_W_K: Annotated[Finite, Field(ge=0, le=1000)]  #: from the end to the ambient, W/K

    parameters = {"conductance_W_K": Fitted("W/K", 0.05)}
    targets = "end"
    families = (END_LOSS, HEAT_LOSS)
    missing_physics = "heat that flows into the housing at {target}"
    excitation = "a warm screw, and a sensor near the end"
    source = "Newton's law at the end face; Kim et al., the convective end"

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return a conductance from the end to the ambient.

        Raises:
            ConfigError: If the end has a prescribed temperature.
        """
        base.free_end(machine, self.target, self.kind)
        return (EndConductance(self.target, self.conductance_W_K),)


class AttachedMass(EffectTable):
    """A body that stores heat, at an end or at a source (with a nut it moves): C dT_b/dt = G (T − T_b)."""

    # and + heat_share (1 − share)/share Q − loss (T_b − T_amb): Q is the source's heat by law, which enters
    # the screw and is `share` of the friction

    kind: Literal["attached_mass"]
    target: Target  #: `left`, `right`, or a source’s name: with a nut the body moves along
    capacity_J_K: Annotated[Finite, Field(ge=1, le=1e6)]  #: heat capacity of the body, J/K
    conductance_W_K: Annotated[Finite, Field(ge=1e-3, le=1000)]  #: between body and the screw’s surface, W/K
    heat_share: Share = 0.0  #: share of the remaining friction heat that enters the body, 0 to 1
    loss_W_K: Annotated[NonNegative, Field(le=1000)] = 0.0  #: between body and air, W/K

    parameters = {
        "capacity_J_K": Fitted("J/K", 1000.0, high=MOST_CAPACITY_J_K, bounded=True),
        "conductance_W_K": Fitted("W/K", 2.0, open_above=True, reciprocal=True),
        "heat_share": Fitted("1", 0.25, open_above=True),
        "loss_W_K": Fitted("W/K", 0.5),
    }
    targets = "place"
    families = (BODY, END_LOSS)
    missing_physics = "a body that stores heat at {target}"
    excitation = "heating and cooling that are fast against the body's time constant"
    source = "a lumped capacity; Li 2022, network nodes"
    rough = 0.025  # one temperature, and one contact with all that a nut passes over

    @classmethod
    def shapes(cls, machine: Description) -> Sequence[Shape]:
        """Return bodies by capacity and conductance, with time constants from half a minute to more than an
        hour.

        Each takes half of the remaining friction heat and loses 0.3 W/K, if these are fitted.
        """
        pairs = ((100.0, 3.0), (500.0, 1.0), (1000.0, 8.0), (2000.0, 5.0), (4000.0, 1.0))
        starting_losses = {"heat_share": 0.5, "loss_W_K": 0.3}
        return [{"capacity_J_K": C, "conductance_W_K": G, **starting_losses} for C, G in pairs]

    @classmethod
    def forms(cls, machine: Description, target: str | None, free: Collection[str]) -> Sequence[Form]:
        """Return the parameters of a body that only stores heat.

        At a source with remaining heat they are followed by those of a body that takes part of it, and of one
        that also loses heat to the air. A free `share` excludes these, because it would compensate them.
        Arguments as in `EffectTable.forms`.
        """
        plain = ("capacity_J_K", "conductance_W_K")
        rubbing = [s for s in machine.source if s.name == target and LEAST_SHARE <= _share(s) < 1.0]
        if not rubbing or f"source.{target}.share" in free:
            return (plain,)
        return plain, (*plain, "heat_share"), (*plain, "heat_share", "loss_W_K")

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the body, and at a source the factor on the heat that enters the screw at once.

        The surface under a nut is warmer than the section. With its resistance R, only 1/(1 + G R) of the
        heat enters at once, and the body touches the surface.

        Raises:
            ConfigError: If the target is no source or cannot warm, or if `heat_share` is given without
                remaining friction heat.
        """
        if self.target not in ("left", "right"):
            at = base.source_free_to_warm(machine, self.target, self.kind)
            source = base.named_source(machine, at, self.kind)
            heated = self._heated(source)
            # the surface has its own temperature: (T_s − T)/R = Q + G (T_b − T_s), R `under_surface_K_W`
            entering = 1.0 / (1.0 + self.conductance_W_K * under_surface_K_W(source, machine.screw))
            return (
                Body(
                    at,
                    self.capacity_J_K,
                    entering * self.conductance_W_K,
                    (heated + 1.0 - entering) / entering,
                    self.loss_W_K,
                ),
                LawScale(at, entering),
            )
        if self.heat_share > 0.0:
            raise ConfigError(
                f'effect "{self.kind}": heat_share is part of a friction, and "{self.target}" is '
                "an end; name the source as target, or remove heat_share"
            )
        name, end_m = f"{self.kind}.{self.target}", base.free_end(machine, self.target, self.kind)
        body = Body(name, self.capacity_J_K, self.conductance_W_K, 0.0, self.loss_W_K)
        return (base.point_heat(name, end_m, heat_W=0.0), body)

    def _heated(self, source: Source) -> float:
        """Return W into the body for each W of a source that enters the screw. Raises `ConfigError`."""
        share = _share(source)
        if self.heat_share == 0.0:
            return 0.0
        # a share that a fit has moved to 1 is no mistake of the configuration's
        if share < LEAST_SHARE or (share == 1.0 and "share" not in source.model_fields_set):
            raise ConfigError(
                f'effect "{self.kind}": heat_share is of the heat that does not enter the screw at once, '
                f'and "{source.name}" has none; give it a law of friction with a share between '
                f"{LEAST_SHARE} and 1, or remove heat_share"
            )
        return self.heat_share * (1.0 - share) / share


def _share(source: Source) -> float:
    """Return the fraction of a source's heat that enters the screw by its law; 1 for a law without a
    fraction.
    """
    return source.share if source.law in DIVIDED_LAWS else 1.0


PASSING = 0.4
"""Of the resistance under a surface that is heated for long, what there is under a nut that passes: 0.6 at
0.05 m/s, 0.3 at 0.3 m/s, for 80 mm on 36 mm of steel (a cylinder's first seconds; Carslaw & Jaeger 1959,
§7.8).
"""


def under_surface_K_W(nut: Source, screw: Screw) -> float:
    """Return the temperature of the surface under a nut above the section's mean, K per W that enters there.

    Between radii a and b over a length l, with w = b² − a²: (w²/4 − a² w/2 + a⁴ ln(b/a))/(2π k l w²). Without
    a bore that is 1/(8π k l). The result is reduced to 40 %, because a nut passes.

    Args:
        nut: The source; one of another shape, or without a length, gives 0.
        screw: Its diameters and conductivity.
    """
    if nut.shape != "nut" or not nut.length_m:
        return 0.0
    b, a = 0.5 * screw.mean_diameter_m(*(nut.stroke_m or (0.0, screw.length_m))), 0.5 * screw.bore_m
    w = b**2 - a**2
    bored = a**4 * math.log(b / a) - a**2 * w / 2 if a else 0.0
    return PASSING * (w**2 / 4 + bored) / (2 * math.pi * screw.conductivity_W_mK * nut.length_m * w**2)
