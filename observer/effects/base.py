"""What all effects share: the class of an effect holds everything that is known of it.

A family is a set of effects that are the same to a log in all but their name, and the one figure that they
share. A film, radiation and a film that turning adds all take heat from the surface: where a log cannot
decide between them, it still shows how much heat goes, as much as a film of so many W/m²K would take.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import Field

from observer.effects.terms import Heat, Term
from observer.errors import ConfigError
from observer.tables.laws import SPEED_LAWS
from observer.tables.quantities import Section
from observer.tables.sections import Description, Source, owner


@dataclass(frozen=True, slots=True)
class Family:
    """What effects have in common, and the figure that says how strong any of them is in effect.

    `missing_physics` is what a model without any of them lacks, `{target}` being the place where `placed`
    asks for one that all share. The figure `key` in `unit` is the heat that an effect takes out of the screw,
    by least squares against how much warmer than the air the screw is: all over its `surface`, at the `end`,
    or on average over the `screw`; or the mean heat that it brings over `time`; or, as its `own`, its
    parameter of that name.
    """

    name: str
    missing_physics: str
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


Target = Annotated[str, Field(min_length=1, max_length=64)]
Shape = Mapping[str, float]
"""An effect at a typical strength: a value of each parameter that a search fits."""
Form = Sequence[str]
"""The parameters of an effect that are fitted, the others being at their defaults."""
AT_END = 0.08
"""Part of the screw within which a place is at its end."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """What a search knows of a parameter.

    `scale` is a change that matters. `neutral` is where the parameter makes the effect nothing, so that a
    strength multiplies what it has beyond; None for one that gives the effect its form, such as a place or a
    time. `starts` are the values from which a search starts, the scale where there are none. `low` and `high`
    are limits where they are narrower than the table's own. A `bounded` parameter's interval must end below
    `high`, for beyond it the effect is another one; one that is `open_above` may stand
    there, being all there is or as good as without limit. Of one that is `reciprocal` more and more makes no
    difference: its uncertainty is that of its reciprocal. A position's scale is the length of the screw over
    `parts`, and its limits are the ends.
    """

    unit: str
    scale: float = math.nan
    neutral: float | None = 0.0
    starts: tuple[float, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    bounded: bool = False
    open_above: bool = False
    reciprocal: bool = False
    parts: int = 0

    def on(self, length_m: float) -> Fitted:
        """Return it for a screw of a length."""
        if not self.parts:
            return self
        return replace(self, scale=length_m / self.parts, low=0.0, high=length_m, parts=0)

    @property
    def level(self) -> bool:
        """Whether it is a place or a temperature, which counts from nowhere in particular."""
        return self.unit in ("m", "°C")


def position(parts: int) -> Fitted:
    """What a search knows of a position on the screw, of which so many parts matter."""
    return Fitted("m", neutral=None, parts=parts)


class EffectTable(Section):
    """One physical effect: the parameters of a `[[effect]]` table, and the terms it adds to the plant."""

    kind: str  #: which effect

    #: the keys that a search may fit, and what it knows of them
    parameters: ClassVar[Mapping[str, Fitted]]
    #: what `target` names, if anything
    targets: ClassVar[Literal["end", "source", "nut", "place", "sensor"] | None] = None
    missing_physics: ClassVar[str]  #: what a model without the effect lacks, with `{target}` in its place
    excitation: ClassVar[str]  #: what a log must hold to identify it
    source: ClassVar[str]  #: where its law comes from
    #: whether it depends on speed, and is sought only where some source has a speed channel
    turning: ClassVar[bool] = False
    #: whether a heat law whose scale is free almost always makes up for it
    confounded_with_scale: ClassVar[bool] = False
    #: what it shares with others that a log may not separate it from, the closest first
    families: ClassVar[tuple[Family, ...]] = ()
    #: of what it explains, the part that its form may leave, for none is quite right
    rough: ClassVar[float] = 0.01
    #: whether it shows in where on its way a nut leaves its heat, which rows far apart do not show
    on_the_way: ClassVar[bool] = False

    @classmethod
    def named(cls) -> str:
        """The kind by which a configuration names the effect: its literal, else `module:Class`."""
        literal = get_args(cls.model_fields["kind"].annotation)
        return str(literal[0]) if literal else f"{cls.__module__}:{cls.__name__}"

    @classmethod
    def bounds(cls, key: str) -> tuple[float, float]:
        """The range of a parameter, from the table."""
        low, high = -math.inf, math.inf
        for limit in cls.model_fields[key].metadata:
            if isinstance(limit, Ge | Gt):
                low = float(limit.ge if isinstance(limit, Ge) else limit.gt)  # type: ignore[arg-type]
            elif isinstance(limit, Le | Lt):
                high = float(limit.le if isinstance(limit, Le) else limit.lt)  # type: ignore[arg-type]
        return low, high

    @classmethod
    def places(cls, machine: Description, free: Collection[str]) -> Sequence[str | None]:
        """The targets at which a search tries the effect, None for an effect without; nowhere where it cannot
        stand or one of the free parameters (dotted keys) already is the effect.
        """
        if cls.turning and all(s.speed_channel is None for s in machine.source):
            return ()
        if cls.targets is None:
            return (None,)
        if cls.targets == "sensor":
            return [s.name for s in machine.sensor]
        if cls.targets == "source":
            return [s.name for s in machine.source if _rubs(s, machine.source)]
        ends = [e for e in ("left", "right") if getattr(machine.boundary, e).kind != "prescribed"]
        nuts = [s.name for s in machine.source if s.shape == "nut" and s.screw_share > 0.0]
        return {"end": ends, "nut": nuts, "place": ends + nuts}[cls.targets]

    @classmethod
    def can_exist(cls, machine: Description) -> bool:
        """Return whether the machine, as configured, has room for the effect; an unknown never proposes one
        without.
        """
        return True

    @classmethod
    def shapes(cls, machine: Description) -> Sequence[Shape]:
        """The forms from which a search starts, at a typical strength."""
        values = product(*(p.starts or (p.scale,) for p in cls.parameters.values()))
        return [dict(zip(cls.parameters, each, strict=True)) for each in values]

    @classmethod
    def forms(cls, machine: Description, target: str | None, free: Collection[str]) -> Sequence[Form]:
        """The sets of parameters that a search fits at a target, the plainest first; of one name all."""
        return (tuple(cls.parameters),)

    @classmethod
    def given(cls, machine: Description) -> Mapping[str, str | bool]:
        """The keys that a search takes from the machine as it is, with their values."""
        return {}

    @classmethod
    def sums(cls, shapes: Sequence[Shape]) -> Sequence[Sequence[int]]:
        """For each shape, the numbers of those of which it is the sum while the effect is weak."""
        return [[i] for i in range(len(shapes))]

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that the effect itself names."""
        named = (getattr(self, key, None) for key in ("speed_channel", "drive_channel"))
        return tuple(channel for channel in named if channel is not None)

    @abstractmethod
    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return what the effect adds to the plant of a machine. Raises `ConfigError` where it cannot."""

    def resolved(self, length_m: float) -> Self:
        """The effect, no finer than sensors on a screw of a length can resolve."""
        return self

    def place(self, length_m: float) -> str | None:
        """Where the effect stands, by name, on a screw of a length; None where that has no name."""
        named = getattr(self, "target", None)
        return None if named is None else str(named)

    def comes_down_to(self, length_m: float) -> tuple[type[EffectTable], str | None] | None:
        """The simpler effect and its target that this one is no different from, if there is one."""
        return None


@dataclass(frozen=True, slots=True)
class Unnamed:
    """Terms beside the effects of a configuration, such as what may differ within a tolerance."""

    added: tuple[Term, ...]
    channels: tuple[str, ...] = ()

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the terms, whatever the machine."""
        return self.added


def _rubs(source: Source, sources: Sequence[Source]) -> bool:
    """Whether a source's heat is that of friction: by a law of speed, its own or the one it is a part of."""
    if source.law == "heat_of":
        source = owner(source, sources)
    return source.law in SPEED_LAWS


def end_at(position_m: float, length_m: float) -> str | None:
    """Return the end that a place belongs to, if any."""
    if position_m < AT_END * length_m:
        return "left"
    return "right" if position_m > (1 - AT_END) * length_m else None


def named_source(machine: Description, name: str, kind: str) -> Source:
    """Return the source of a name. Raises `ConfigError`."""
    return machine.source[_index(name, [s.name for s in machine.source], "source", kind)]


def named_sensor(machine: Description, name: str, kind: str) -> str:
    """Return the name of a sensor that exists. Raises `ConfigError`."""
    return machine.sensor[_index(name, [s.name for s in machine.sensor], "sensor", kind)].name


def _index(name: str, names: list[str], what: str, kind: str) -> int:
    if name not in names:
        raise ConfigError(f'effect "{kind}": target "{name}" is no {what}; give one of {", ".join(names)}')
    return names.index(name)


def point_heat(name: str, position_m: float, **law: Any) -> Heat:
    """Return a source at a place whose heat is that of its law."""
    source = Source(
        name=name, shape="point", position_m=position_m, estimate=False, initial_sigma_W=1.0, **law
    )
    return Heat(source)


def free_end(machine: Description, end: str, kind: str) -> float:
    """Return the position of an end whose temperature is not prescribed. Raises `ConfigError`."""
    if getattr(machine.boundary, end).kind == "prescribed":
        raise ConfigError(
            f'effect "{kind}": the {end} end has a prescribed temperature, which no heat can change; '
            "remove the effect or the prescription"
        )
    return 0.0 if end == "left" else machine.screw.length_m


def source_free_to_warm(machine: Description, name: str, kind: str) -> str:
    """Return the name of a source that exists and does not stand at an end with a prescribed temperature.

    Raises `ConfigError`.
    """
    source = named_source(machine, name, kind)
    heats_screw(source, kind)
    end = {0.0: "left", machine.screw.length_m: "right"}.get(source.position_m or 0.0)
    if source.shape == "point" and end is not None:
        free_end(machine, end, kind)
    return name


def heats_screw(source: Source, kind: str) -> None:
    """Raise `ConfigError` where all of a source's heat goes into nodes."""
    if source.screw_share == 0.0:
        raise ConfigError(f'effect "{kind}": "{source.name}" heats nodes only; name one that heats the screw')


def on_screw(machine: Description, key: str, position_m: float, kind: str) -> None:
    """Raise `ConfigError` where a position lies beyond the screw."""
    if position_m > machine.screw.length_m:
        raise ConfigError(
            f'effect "{kind}": {key} = {position_m} m lies beyond the screw\'s '
            f"length_m = {machine.screw.length_m} m; fix one of them"
        )


def speed_channel(machine: Description, given: str | None, kind: str) -> str:
    """Return the channel of the screw's speed: the one given, or the first that a source reads."""
    for channel in (given, *(s.speed_channel for s in machine.source)):
        if channel is not None:
            return channel
    raise ConfigError(f'effect "{kind}": no source has a speed_channel; name it in the effect')
