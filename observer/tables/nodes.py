"""The configuration's tables of bodies beside the screw: nodes that store heat, and their links."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from observer.tables import quantities
from observer.tables.quantities import Section

AMBIENT = "ambient"
"""What a link names as its end where it leads into the air."""


class Node(Section):
    """A body of one temperature: a bearing's ring, a housing, the nut, the table."""

    name: quantities.Name  #: the name that sources, links and sensors use
    capacity_J_K: quantities.Capacity  #: heat capacity: mass times specific heat


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
OPTIONAL = ("filling_W_mK",)
"""Belongs to a gap."""


class Link(Section):
    """Heat that passes between two places, described in one of several ways.

    A place is a node, the ambient, or the screw where a source stands, by that source's name.
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

    @model_validator(mode="after")
    def _described_in_one_way(self) -> Link:
        if self.between[0] == self.between[1]:
            raise ValueError(f'between names "{self.between[0]}" twice; a link needs two places')
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
    """Raise `ValueError` for a node without a link, and for a link whose ends are unknown or hold no node.

    `sources` are the names of all sources, `placed` of those that stand somewhere on the screw.
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
            raise ValueError(f"link {' – '.join(one.between)}: one of the two is to be a node")
    for name in names:
        if not any(name in one.between for one in link):
            raise ValueError(f'node "{name}" has no link; give it one, or remove it')
