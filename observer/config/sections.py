"""The machine as the configuration describes it: screw, surface, ends, air and sources.

Every unit and every range of these tables is checked here, once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from observer.config import quantities
from observer.config.laws import LAWS, HeatLaw, Surface
from observer.config.mounting import Supports
from observer.config.quantities import Section
from observer.config.screw import Screw
from observer.config.sensors import Sensor, placed_along

AMBIENT = "ambient"
"""What a link names as its end where it leads into the air."""
LAW_UNCERTAINTY, UNSEEN_LAW_UNCERTAINTY = 0.2, 0.3
"""How well heat laws are known where nothing else is said: beside thermocouples on the screw, which soon know
better than any law, and without them, as preload torques are.
"""
Tolerated = Annotated[quantities.NonNegative, Field(le=1)]


class Node(Section):
    """A body of one temperature: a bearing's ring, a housing, the nut, the table."""

    name: quantities.Name  #: the name that sources, links and sensors use
    capacity_J_K: quantities.Capacity  #: heat capacity: mass times specific heat
    #: σ of its capacity, relative; – is `tolerance.capacity`
    tolerance: Tolerated | None = None


WAYS: tuple[tuple[str, ...], ...] = (
    ("conductance_W_K",),
    ("resistance_K_W",),
    ("film_W_m2K", "area_m2"),
    ("conductivity_W_mK", "length_m", "area_m2"),
    ("conductivity_W_mK", "length_m", "inner_diameter_m", "outer_diameter_m"),
    ("gap_m", "touching", "conductivities_W_mK", "area_m2"),
    ("balls", "conductivities_W_mK", "semi_axes_m"),
)
"""The ways in which a link can be described: the keys that belong together."""
OPTIONAL = ("filling_W_mK", "factor", "tolerance")
"""Keys that any description may have; the filling belongs to a gap."""


class Link(Section):
    """Heat that passes between two places, described in one of several ways.

    A place is a node, the ambient, or the screw where a source stands, by that source's name. The given keys
    must be exactly those of one line of `WAYS`, and one of the two places must be a node.
    """

    between: tuple[quantities.Name, quantities.Name]  #: the two places
    conductance_W_K: quantities.Conductance | None = None  #: heat flow per kelvin
    resistance_K_W: Annotated[quantities.Positive, Field(ge=1e-7, le=1e9)] | None = None  #: its reciprocal
    film_W_m2K: quantities.EndFilm | None = None  #: film or contact coefficient
    area_m2: quantities.Area | None = None  #: area it acts on
    conductivity_W_mK: quantities.Conductivity | None = None  #: conductivity of a bar or ring
    length_m: quantities.Length | None = None  #: length of a bar; width of a ring
    inner_diameter_m: quantities.Diameter | None = None  #: where the ring begins
    outer_diameter_m: quantities.Diameter | None = None  #: where it ends
    gap_m: quantities.Length | None = None  #: sum of the roughness heights of both faces
    #: fraction of the area in real contact
    touching: Annotated[quantities.Positive, Field(le=1)] | None = None
    #: of both faces; of ball and ring
    conductivities_W_mK: tuple[quantities.Conductivity, quantities.Conductivity] | None = None
    filling_W_mK: quantities.NonNegative = 0.0  #: conductivity in the gap: air 0.026, grease 0.15
    balls: Annotated[quantities.Count, Field(ge=1, le=1000)] | None = None  #: how many balls, in all rows
    #: both semi-axes of the contact ellipse of one ball
    semi_axes_m: tuple[quantities.Length, quantities.Length] | None = None

    #: multiplies the conductance described, as fitted by `observer calibrate`
    factor: Annotated[quantities.Positive, Field(ge=1e-3, le=1e3)] = 1.0
    #: σ of its conductance, relative; – is `tolerance.link`
    tolerance: Tolerated | None = None

    @property
    def key(self) -> str:
        """The beginning of its parameters' keys: `link.` and both places, joined by a hyphen in the
        configured order.
        """
        return f"link.{self.between[0]}-{self.between[1]}"

    @model_validator(mode="after")
    def _described_in_one_way(self) -> Link:
        if self.between[0] == self.between[1]:
            raise ValueError(f'between names "{self.between[0]}" twice; name two different places')
        stated = self.model_fields_set - {"between", *OPTIONAL}
        if stated not in [set(way) for way in WAYS]:
            ways = "; or ".join(", ".join(way) for way in WAYS)
            raise ValueError(f"give the keys of one way to describe a link, and no others: {ways}")
        if "filling_W_mK" in self.model_fields_set and self.gap_m is None:
            raise ValueError("filling_W_mK belongs to gap_m; remove it")
        inner, outer = self.inner_diameter_m, self.outer_diameter_m
        if inner is not None and outer is not None and not inner < outer:
            raise ValueError("inner_diameter_m is to be below outer_diameter_m; fix one of them")
        return self


def check_places(
    node: tuple[Node, ...], link: tuple[Link, ...], sources: tuple[str, ...], placed: tuple[str, ...]
) -> None:
    """Check that nodes, links and sources fit together.

    Args:
        node: The nodes.
        link: The links.
        sources: Names of all sources.
        placed: Names of the sources at a place on the screw.

    Raises:
        ValueError: If a node has a name that is taken, or no link. Also if a link has an unknown end, or no
            node at either end.
    """
    names = [n.name for n in node]
    for name in names:
        if names.count(name) > 1 or name in sources or name == AMBIENT:
            raise ValueError(f'node "{name}": the name is taken; give each node one of its own')
    for one in link:
        for end in one.between:
            if end not in (*names, *placed, AMBIENT):
                raise ValueError(
                    f'link {" – ".join(one.between)}: "{end}" is neither a node, nor "{AMBIENT}", nor a '
                    "source on the screw; fix the name"
                )
        if not any(end in names for end in one.between):
            raise ValueError(f"link {' – '.join(one.between)}: neither is a node; name one of [[node]]")
    for name in names:
        if not any(name in one.between for one in link):
            raise ValueError(f'node "{name}" has no link; give it one, or remove it')


class Bed(Section):
    """The bed, table or scale against which the screw's growth is measured; it expands too."""

    expansion_1_K: quantities.Expansion  #: its thermal expansion; 8e-6 for a glass scale, 11e-6 for cast iron
    channel: quantities.Channel | None = None  #: the channel that measures its temperature
    on: quantities.Name | None = None  #: the node whose temperature it has

    _one = quantities.exactly_one("channel", "on")


class Ambient(Section):
    """The air around the screw: one constant, or a channel of the log."""

    temperature_degC: quantities.Air | None = None  #: a constant air temperature
    channel: quantities.Channel | None = None  #: the channel that measures it

    _one = quantities.exactly_one("temperature_degC", "channel")


class Boundary(Section):
    """One end of the screw."""

    #: `"insulated"`, `"convective"` (with a coefficient) or `"prescribed"` (with a channel)
    kind: Literal["insulated", "convective", "prescribed"] = "insulated"
    coefficient_W_m2K: quantities.EndFilm | None = None  #: film coefficient of a convective end
    channel: quantities.Channel | None = None  #: the channel that measures a prescribed end's temperature

    @model_validator(mode="after")
    def _complete(self) -> Boundary:
        if (self.kind == "convective") != (self.coefficient_W_m2K is not None):
            raise ValueError(
                'coefficient_W_m2K belongs to kind = "convective", and is needed there; give both or neither'
            )
        if (self.kind == "prescribed") != (self.channel is not None):
            raise ValueError(
                'channel belongs to kind = "prescribed", and is needed there; give both or neither'
            )
        return self


class Boundaries(Section):
    """Both ends."""

    left: Boundary = Boundary()
    right: Boundary = Boundary()


class Source(HeatLaw):
    """Heat entering the screw: where (shape) and how much (law).

    Each shape needs its own keys and rejects those of others. Shares of `nodes` may not exceed 1, and must
    add up to 1 for a source of shape `node`.
    """

    name: quantities.Name  #: names the columns and keys of its heat
    #: `"nut"`, `"point"`, `"band"`, or `"node"`: it heats nodes only
    shape: Literal["nut", "point", "band", "node"]
    # where
    length_m: quantities.Length | None = None  #: nut: its length
    #: nut: travel of its centre, `[from, to]`; without `position_channel` its heat is uniform there
    stroke_m: tuple[quantities.Position, quantities.Position] | None = None
    position_channel: quantities.Channel | None = None  #: nut: the channel of its centre's position in m
    #: nut: lead of the screw; shows with the speed whether the samples resolve the path
    lead_m: quantities.Lead | None = None
    covers_film: quantities.Flag = False  #: nut: the screw loses no heat to the air under it
    position_m: quantities.Position | None = None  #: point: its position
    from_m: quantities.Position | None = None  #: band: where it begins
    to_m: quantities.Position | None = None  #: band: where it ends
    #: shares of the heat that enter [nodes](#node): `{ ring = 0.3, housing = 0.2 }`; the rest enters the
    #: screw
    nodes: dict[quantities.Name, quantities.Share] = Field(default_factory=dict)
    # how it is estimated
    estimate: quantities.Flag = True  #: `false`: the law is the heat; at least one source must be estimated
    #: random walk of the heat about its law: W after 1 s, grows with √t
    random_walk_W_sqrt_s: quantities.HeatSigma = 0.1
    #: time constant with which that deviation decays; – is a pure random walk
    time_constant_s: quantities.Duration | None = None
    #: relative σ of the law's scale; a jump of the law adds this part of it to σ; – is 0.2,
    #: and 0.3 where [no thermocouple sits on the
    #: screw](../explanation/learning.md#without-a-sensor-on-the-screw)
    law_uncertainty: quantities.Factor | None = None
    #: `forecast` from a log: relative σ of the scale after run-in, from `calibrate`; – is
    #: `law_uncertainty`
    scale_tolerance: quantities.Factor | None = None
    #: `forecast` from a log: extra friction when work begins, relative to the law, from `calibrate`; with the
    #: two keys below
    run_in: Annotated[quantities.Finite, Field(ge=-1, le=10)] | None = None
    #: time constant with which that fades
    run_in_s: quantities.Duration | None = None
    run_in_tolerance: quantities.Factor | None = None  #: σ of `run_in`
    #: σ of the heat at the start
    initial_sigma_W: Annotated[quantities.HeatSigma, Field(gt=0)] = 30.0

    @model_validator(mode="after")
    def _shape_is_complete(self) -> Source:
        required = {"nut": ("length_m",), "point": ("position_m",), "band": ("from_m", "to_m"), "node": ()}[
            self.shape
        ]
        for key in required:
            if getattr(self, key) is None:
                raise ValueError(f'shape = "{self.shape}" needs {key}; give it, or another shape')
        belongs = {
            "length_m": "nut", "stroke_m": "nut", "position_channel": "nut", "lead_m": "nut",
            "position_m": "point", "from_m": "band", "to_m": "band",
        }  # fmt: skip
        for key, shape in belongs.items():
            if getattr(self, key) is not None and self.shape != shape:
                raise ValueError(
                    f'{key} belongs to shape = "{shape}", not "{self.shape}"; remove it, or correct shape'
                )
        if self.covers_film and self.shape != "nut":
            raise ValueError(
                f'covers_film belongs to shape = "nut", not "{self.shape}"; remove it, or correct shape'
            )
        if self.shape == "nut" and self.stroke_m is None and self.position_channel is None:
            raise ValueError("a nut needs position_channel or stroke_m; give one of them")
        for low, high in (self.stroke_m or (None, None), (self.from_m, self.to_m)):
            if low is not None and high is not None and not low < high:
                raise ValueError(
                    f"the stretch {low} … {high} m is empty; the first number must be the smaller"
                )
        return self

    @model_validator(mode="after")
    def _runs_in_as_a_whole(self) -> Source:
        of = (self.run_in, self.run_in_s, self.run_in_tolerance)
        if any(v is None for v in of) and any(v is not None for v in of):
            raise ValueError("run_in, run_in_s and run_in_tolerance belong together: give all three, or none")
        return self

    @model_validator(mode="after")
    def _heat_goes_somewhere(self) -> Source:
        total = sum(self.nodes.values())
        if self.shape == "node" and not math.isclose(total, 1.0, abs_tol=1e-6):
            raise ValueError(f'shape = "node": the shares of nodes add up to {total:g}, not 1; correct them')
        if total > 1.0 + 1e-6:
            raise ValueError(f"the shares of nodes add up to {total:g}, more than 1; lower them")
        return self

    @property
    def own_or_followed(self) -> str:
        """Name of the source whose estimated heat drives this one: `heat_of` for a follower, else its own."""
        return self.heat_of if self.follows and self.heat_of is not None else self.name

    @property
    def screw_share(self) -> float:
        """Part of the heat that enters the screw, 0 to 1; the rest goes into nodes."""
        left = 1.0 - sum(self.nodes.values())
        return left if left > 1e-6 else 0.0

    @model_validator(mode="after")
    def _law_is_complete(self) -> Source:
        if self.law is None and not self.estimate:
            raise ValueError(f"estimate = false needs a heat law; give one of {', '.join(LAWS)}")
        if self.stroke_share and self.stroke_m is None:
            raise ValueError("stroke_share is the stroke's part of the screw; give stroke_m")
        if self.nut_friction is not None and (self.nut_friction.lead_m is None) == (self.lead_m is None):
            raise ValueError("nut_friction needs the lead once; give lead_m in one of the two tables")
        return self


def covers_only(source: Source, screw: Screw, position_m: float) -> bool:
    """Return whether the whole nut is on the screw.

    Args:
        source: The nut, with its length.
        screw: The screw.
        position_m: Position of the nut's centre, m.
    """
    half_m = 0.5 * (source.length_m or 0.0) - 1e-9
    return half_m <= position_m <= screw.length_m - half_m


def following(sources: Sequence[Source]) -> dict[str, list[tuple[float, Source]]]:
    """Return the sources that follow another.

    Args:
        sources: All sources.

    Returns:
        For each followed source's name, its followers with their ratio to its heat.
    """
    followers: dict[str, list[tuple[float, Source]]] = {}
    for source in sources:
        if source.follows and source.heat_of is not None:
            followers.setdefault(source.heat_of, []).append((part_of_heat(source), source))
    return followers


def part_of_heat(source: Source) -> float:
    """Return the ratio of a source's heat to that of the source named by its `heat_of`: scale /
    heat_ratio.
    """
    return source.scale / (source.heat_ratio or 1.0)


def law_channels(source: Source, sources: Sequence[Source]) -> tuple[str, ...]:
    """Return the channels that a source's heat law reads, in the order of its arguments.

    Args:
        source: The source; one with `heat_of` reads the channels of the other source. Without a law there are
            none.
        sources: All sources.
    """
    if source.law is None:
        return ()
    return owner(source, sources).law_channels if source.law == "heat_of" else source.law_channels


def owner(source: Source, sources: Sequence[Source]) -> Source:
    """Return the source that the `heat_of` law of a source names.

    Raises:
        StopIteration: If no source has that name; a checked configuration excludes it.
    """
    return next(other for other in sources if other.name == source.heat_of)


class Description(Section):
    """The physical part of a configuration, from which the model is built.

    A sensor `along` a nut's way is replaced by one for each of five places. Names of nodes that do not exist
    are rejected. So is a nut that covers the film and leaves the screw, and a link to an end with a
    prescribed temperature.
    """

    screw: Screw
    surface: Surface = Surface()
    ambient: Ambient
    boundary: Boundaries = Boundaries()
    supports: Supports | None = None
    bed: Bed | None = None
    node: tuple[Node, ...] = Field(default=(), max_length=100)
    link: tuple[Link, ...] = Field(default=(), max_length=1000)
    source: tuple[Source, ...] = Field(min_length=1, max_length=32)
    sensor: tuple[Sensor, ...] = Field(min_length=1, max_length=100)

    @model_validator(mode="before")
    @classmethod
    def _along_the_way(cls, table: Any) -> Any:
        if not isinstance(table, dict) or not isinstance(sensors := table.get("sensor"), list | tuple):
            return table
        expanded: list[Any] = []
        for one in sensors:
            moves = isinstance(one, dict) and one.get("along") and one.get("position_m") is None
            expanded += placed_along(one, list(table.get("source") or ())) if moves else [one]
        return table | {"sensor": expanded}

    @property
    def screw_is_seen(self) -> bool:
        """Whether a thermocouple is on the screw; without one an estimate also rests on the heat laws."""
        return any(s.sees_the_screw for s in self.sensor)

    def law_uncertainty(self, source: Source) -> float:
        """Return the relative standard deviation of a source's law.

        Args:
            source: Its own value counts. Otherwise it is 0.2, or 0.3 if no thermocouple is on the screw.
        """
        if source.law_uncertainty is not None:
            return source.law_uncertainty
        return LAW_UNCERTAINTY if self.screw_is_seen else UNSEEN_LAW_UNCERTAINTY

    @model_validator(mode="after")
    def _nodes_are_known(self) -> Description:
        names = {n.name for n in self.node}
        self._linked_ends_are_free()
        self._covering_nuts_stay_on_the_screw()
        placed = tuple(s.name for s in self.source if s.shape != "node")
        check_places(self.node, self.link, tuple(s.name for s in self.source), placed)
        for place, used in (
            *((f"source {s.name}: nodes", name) for s in self.source for name in s.nodes),
            *((f"sensor {s.name}: on", s.on) for s in self.sensor if s.on is not None),
            *(("bed: on", b.on) for b in (self.bed,) if b is not None and b.on is not None),
        ):
            if used not in names:
                node_names = ", ".join(sorted(names)) or "none yet, write [[node]]"
                raise ValueError(f'{place} names "{used}", which is no node; the nodes are: {node_names}')
        return self

    def _covering_nuts_stay_on_the_screw(self) -> None:
        for source in self.source:
            if not source.covers_film or source.stroke_m is None:
                continue
            if off_screw_m := [at_m for at_m in source.stroke_m if not covers_only(source, self.screw, at_m)]:
                raise ValueError(
                    f"source {source.name}: covers_film needs the whole nut on the screw; with its centre at "
                    f"{off_screw_m[0]:g} m it reaches beyond the end; correct stroke_m or length_m"
                )

    def _linked_ends_are_free(self) -> None:
        linked = {end for one in self.link for end in one.between}
        for source in self.source:
            end = {0.0: "left", self.screw.length_m: "right"}.get(source.position_m or 0.0)
            prescribed = end is not None and getattr(self.boundary, end).kind == "prescribed"
            if prescribed and source.name in linked and source.shape == "point":
                raise ValueError(
                    f'link to "{source.name}": the {end} end has a prescribed temperature, which no heat can '
                    "change; remove the link or the prescription"
                )
