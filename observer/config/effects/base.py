"""The base class of all effects: the class of an effect holds all its properties.

A family is a set of effects that a log cannot distinguish, and the one figure that they share. A film,
radiation and a film due to rotation all take heat from the surface. If a log cannot decide between them, it
still shows the amount of heat, as an equivalent film coefficient in W/m²K.
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

from observer.config.effects.terms import Heat, Term
from observer.config.laws import SPEED_LAWS
from observer.config.quantities import Section
from observer.config.sections import Description, Source, owner
from observer.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Family:
    """The common property of effects, and the figure that gives the effective strength of any of them.

    The figure is the heat that an effect takes out of the screw, by least squares against the screw's
    temperature above ambient.

    Attributes:
        name: Name of the family.
        missing_physics: What a model without any of them lacks; `{target}` is the place of a `placed` family.
        key: Name of the figure.
        unit: Its unit.
        against: Where that temperature is taken: over the `surface`, at the `end`, or as a mean over the
            `screw`. For `time` the figure is the mean heat that the effect brings, and for `own` its
            parameter `key`.
        placed: Whether the members must act at one common place.
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
    """The prior knowledge of a parameter for a search.

    Attributes:
        unit: Unit of the parameter, `1` for a ratio.
        scale: A change that matters, in that unit.
        neutral: Value at which the effect vanishes, so that a strength multiplies the difference to it. None
            for a parameter of the effect's form, such as a place or a time.
        starts: Values from which a search starts; the scale if empty.
        low: Lower limit, if it is narrower than the table's own.
        high: Upper limit, likewise.
        bounded: Whether the parameter's interval must end below `high`; beyond that the effect is another.
        open_above: Whether the parameter may be at `high`, which is then the whole or no limit in practice.
        reciprocal: Whether the uncertainty is that of the reciprocal, since larger values make no difference.
        parts: For a position: its scale is the screw's length over `parts`, and its limits are the ends.
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
        """Return the same for a screw of a length in m; only a position depends on it."""
        if not self.parts:
            return self
        return replace(self, scale=length_m / self.parts, low=0.0, high=length_m, parts=0)

    @property
    def level(self) -> bool:
        """Whether it is a place or a temperature, whose zero is arbitrary; its form error is then not
        relative.
        """
        return self.unit in ("m", "°C")


def position(parts: int) -> Fitted:
    """Return the prior knowledge of a position on the screw.

    Args:
        parts: Number of parts of the screw that sensors can distinguish.
    """
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
        """Return the kind by which a configuration names the effect: its literal, else `module:Class`."""
        literal = get_args(cls.model_fields["kind"].annotation)
        return str(literal[0]) if literal else f"{cls.__module__}:{cls.__name__}"

    @classmethod
    def bounds(cls, key: str) -> tuple[float, float]:
        """Return lower and upper limit of a parameter by the table's field, infinite without a limit.

        Args:
            key: Key of the parameter.

        Raises:
            KeyError: If the table has no such key.
        """
        low, high = -math.inf, math.inf
        for limit in cls.model_fields[key].metadata:
            if isinstance(limit, Ge | Gt):
                low = float(limit.ge if isinstance(limit, Ge) else limit.gt)  # type: ignore[arg-type]
            elif isinstance(limit, Le | Lt):
                high = float(limit.le if isinstance(limit, Le) else limit.lt)  # type: ignore[arg-type]
        return low, high

    @classmethod
    def places(cls, machine: Description, free: Collection[str]) -> Sequence[str | None]:
        """Return the targets at which a search tries the effect.

        Args:
            machine: The machine as configured.
            free: Dotted keys of its free parameters.

        Returns:
            Names of ends, sources or sensors; a single None for an effect without a target. Empty if the
            effect is impossible, or if a free parameter is the effect.
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
        """Return whether the machine, as configured, can have the effect; an *unknown* proposes no other."""
        return True

    @classmethod
    def shapes(cls, machine: Description) -> Sequence[Shape]:
        """Return the values from which a search starts, at a typical strength.

        By default they are all combinations of the parameters' starts.

        Args:
            machine: The machine, for lengths.
        """
        values = product(*(p.starts or (p.scale,) for p in cls.parameters.values()))
        return [dict(zip(cls.parameters, combination, strict=True)) for combination in values]

    @classmethod
    def forms(cls, machine: Description, target: str | None, free: Collection[str]) -> Sequence[Form]:
        """Return the sets of parameters that a search fits at a target, the simplest first.

        Args:
            machine: The machine as configured.
            target: Name of the target, or None.
            free: Dotted keys of its free parameters.
        """
        return (tuple(cls.parameters),)

    @classmethod
    def fixed_keys(cls, machine: Description) -> Mapping[str, str | bool]:
        """Return the keys that a search takes from the configured machine, with their values."""
        return {}

    @classmethod
    def sums(cls, shapes: Sequence[Shape]) -> Sequence[Sequence[int]]:
        """Return for each shape the numbers of the shapes whose sum it is while the effect is weak.

        A search predicts only these and adds them up. By default each shape stands for itself.
        """
        return [[i] for i in range(len(shapes))]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the effect itself names; the log must contain them."""
        named = (getattr(self, key, None) for key in ("speed_channel", "drive_channel"))
        return tuple(channel for channel in named if channel is not None)

    @abstractmethod
    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the terms that the effect adds to the plant.

        Args:
            machine: The machine with all its tables.

        Raises:
            ConfigError: If the machine cannot have the effect; the message names the effect, the key and a
                remedy.
        """

    def resolved(self, length_m: float) -> Self:
        """Return the effect, no finer than sensors can resolve.

        Args:
            length_m: Length of the screw, m.
        """
        return self

    def place(self, length_m: float) -> str | None:
        """Return the name of the place where the effect acts; None if it has no name.

        Args:
            length_m: Length of the screw, m, by which a position belongs to an end.
        """
        named = getattr(self, "target", None)
        return None if named is None else str(named)

    def comes_down_to(self, length_m: float) -> tuple[type[EffectTable], str | None] | None:
        """Return the simpler effect and target from which this one cannot be distinguished, else None.

        Args:
            length_m: Length of the screw, m.
        """
        return None


@dataclass(frozen=True, slots=True)
class Unnamed:
    """Terms in addition to the effects of a configuration, such as changes within a tolerance.

    Attributes:
        added: The terms.
        channels: Channels that they read.
    """

    added: tuple[Term, ...]
    channels: tuple[str, ...] = ()

    def terms(self, machine: Description) -> tuple[Term, ...]:
        """Return the terms, whatever the machine."""
        return self.added


def _rubs(source: Source, sources: Sequence[Source]) -> bool:
    """Whether a source's heat is friction: by a law of speed, its own or that of the source that it
    follows.
    """
    if source.law == "heat_of":
        source = owner(source, sources)
    return source.law in SPEED_LAWS


def end_at(position_m: float, length_m: float) -> str | None:
    """Return the end to which a place belongs; None for a place between.

    Args:
        position_m: The place, m.
        length_m: Length of the screw, m. The outer 8 % belong to an end.
    """
    if position_m < AT_END * length_m:
        return "left"
    return "right" if position_m > (1 - AT_END) * length_m else None


def named_source(machine: Description, name: str, kind: str) -> Source:
    """Return the source of a name.

    Args:
        machine: The machine.
        name: The effect's `target`.
        kind: The effect's kind, for the message.

    Raises:
        ConfigError: If no source has this name.
    """
    return machine.source[_index(name, [s.name for s in machine.source], "source", kind)]


def named_sensor(machine: Description, name: str, kind: str) -> str:
    """Return the name of an existing sensor; arguments as in `named_source`.

    Raises:
        ConfigError: If no sensor has this name.
    """
    return machine.sensor[_index(name, [s.name for s in machine.sensor], "sensor", kind)].name


def _index(name: str, names: list[str], noun: str, kind: str) -> int:
    if name not in names:
        raise ConfigError(f'effect "{kind}": target "{name}" is no {noun}; give one of {", ".join(names)}')
    return names.index(name)


def point_heat(name: str, position_m: float, **law: Any) -> Heat:
    """Return a source at a place with the heat of its law; it is not estimated.

    Args:
        name: Name of the source.
        position_m: Its place on the screw, m.
        **law: Keys of the heat law, such as `heat_W`.
    """
    source = Source(
        name=name, shape="point", position_m=position_m, estimate=False, initial_sigma_W=1.0, **law
    )
    return Heat(source)


def free_end(machine: Description, end: str, kind: str) -> float:
    """Return the position of an end, m, whose temperature may change.

    Args:
        machine: The machine.
        end: `left` or `right`.
        kind: The effect's kind, for the message.

    Raises:
        ConfigError: If the end has a prescribed temperature.
    """
    if getattr(machine.boundary, end).kind == "prescribed":
        raise ConfigError(
            f'effect "{kind}": the {end} end has a prescribed temperature, which no heat can change; '
            "remove the effect or the prescription"
        )
    return 0.0 if end == "left" else machine.screw.length_m


def source_free_to_warm(machine: Description, name: str, kind: str) -> str:
    """Return the name of an existing source that can warm its place; arguments as in `named_source`.

    Raises:
        ConfigError: If no source has this name, if it heats nodes only, or if it is a point at an end with a
            prescribed temperature.
    """
    source = named_source(machine, name, kind)
    heats_screw(source, kind)
    end = {0.0: "left", machine.screw.length_m: "right"}.get(source.position_m or 0.0)
    if source.shape == "point" and end is not None:
        free_end(machine, end, kind)
    return name


def heats_screw(source: Source, kind: str) -> None:
    """Refuse a source that heats nodes only.

    Raises:
        ConfigError: If all of the source's heat goes into nodes.
    """
    if source.screw_share == 0.0:
        raise ConfigError(f'effect "{kind}": "{source.name}" heats nodes only; name one that heats the screw')


def on_screw(machine: Description, key: str, position_m: float, kind: str) -> None:
    """Refuse a position beyond the screw.

    Args:
        machine: The machine.
        key: Key of the position, for the message.
        position_m: The position, m.
        kind: The effect's kind, for the message.

    Raises:
        ConfigError: If the position exceeds the screw's length.
    """
    if position_m > machine.screw.length_m:
        raise ConfigError(
            f'effect "{kind}": {key} = {position_m} m lies beyond the screw\'s '
            f"length_m = {machine.screw.length_m} m; fix one of them"
        )


def speed_channel(machine: Description, named_channel: str | None, kind: str) -> str:
    """Return the channel of the screw's speed.

    Args:
        machine: The machine.
        named_channel: Channel that the effect names. None takes the first that a source reads.
        kind: The effect's kind, for the message.

    Raises:
        ConfigError: If neither the effect nor a source names a channel.
    """
    for channel in (named_channel, *(s.speed_channel for s in machine.source)):
        if channel is not None:
            return channel
    raise ConfigError(
        f'effect "{kind}": no source has a speed_channel; give the effect its own speed_channel'
    )
