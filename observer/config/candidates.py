"""The sensors that could be mounted, with place and cost, from which `observer place` chooses."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from observer.config import quantities
from observer.config.quantities import Section
from observer.config.sensors import PROBING_S, Measuring, Sensor, SensorKind, refuse_foreign_keys

MOST_PLACES = 200
"""The most places that candidates may have altogether."""


class SensorCandidate(Measuring):
    """A sensor that could be mounted, or one anywhere along a stretch of the screw; or a probing cycle.

    Exactly one place is needed: `position_m`, `on`, or a stretch with `from_m`, `to_m` and `spacing_m`. Keys
    of the other `kind` are rejected, and `every_s` without `occasional`.
    """

    name: quantities.Name  #: its name; places of a stretch get `_250mm` added
    #: `"temperature"`, or `"displacement"`: a [probe, a laser, a dial gauge](../how-to/probe.md)
    kind: SensorKind = "temperature"
    position_m: quantities.Position | None = None  #: its position on the screw
    on: quantities.Name | None = None  #: the node that it would sit on
    from_m: quantities.Position | None = None  #: where a stretch of the screw begins
    to_m: quantities.Position | None = None  #: where it ends
    #: how far apart the places of a stretch are tried
    spacing_m: Annotated[quantities.Length, Field(ge=1e-4)] | None = None
    occasional: quantities.Flag = False  #: displacement: one reading each `every_s`
    #: occasional displacement: how far apart its readings are; – is an hour
    every_s: Annotated[quantities.Positive, Field(ge=1, le=86_400)] | None = None
    cost: quantities.NonNegative = 1.0  #: what it costs, mounting included, in any unit

    @model_validator(mode="after")
    def _is_somewhere(self) -> SensorCandidate:
        stretch = (self.from_m, self.to_m, self.spacing_m)
        ways = [self.position_m is not None, self.on is not None, any(x is not None for x in stretch)]
        if sum(ways) != 1 or (ways[2] and None in stretch):
            raise ValueError("give position_m, or on, or from_m, to_m and spacing_m together")
        if self.from_m is not None and self.to_m is not None and not self.from_m < self.to_m:
            raise ValueError(
                f"the stretch {self.from_m} … {self.to_m} m is empty; the first number must be the smaller"
            )
        refuse_foreign_keys(self, self.kind)
        if self.every_s is not None and not self.occasional:
            raise ValueError("every_s is of an occasional displacement; add occasional = true, or remove it")
        return self

    @property
    def probing_s(self) -> float | None:
        """Interval of an occasional displacement's readings, s; None for any other sensor."""
        return (self.every_s or PROBING_S) if self.occasional else None

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors that the candidate offers, one for each place of a stretch, both ends included.

        Places are evenly spaced, as near to `spacing_m` as fits. Names end in the place in mm, channels of
        displacements in `_um`.
        """
        sensor_keys = self.model_dump(
            exclude_unset=True, include=set(Sensor.model_fields) - {"name", "channel"}
        )
        unit = "_um" if self.kind == "displacement" else ""
        if self.from_m is None or self.to_m is None or self.spacing_m is None:
            return (Sensor(name=self.name, channel=self.name + unit, **sensor_keys),)
        steps = max(1, round((self.to_m - self.from_m) / self.spacing_m))
        places_m = np.linspace(self.from_m, self.to_m, steps + 1).round(6).tolist()
        names = [f"{self.name}_{1000 * x_m:g}mm" for x_m in places_m]
        return tuple(
            Sensor(name=name, channel=name + unit, position_m=x_m, **sensor_keys)
            for name, x_m in zip(names, places_m, strict=True)
        )


class CandidateFile(Section):
    """A file of candidates."""

    candidate: tuple[SensorCandidate, ...] = Field(min_length=1, max_length=MOST_PLACES)  #: the tables in it


def candidate_problems(
    candidates: Sequence[SensorCandidate], length_m: float, nodes: Collection[str]
) -> Iterator[str]:
    """Yield why candidates cannot be mounted on a machine, a sentence with a remedy each.

    Args:
        candidates: The candidates of all files.
        length_m: Length of the screw, m.
        nodes: Names of the nodes.
    """
    places = 0
    for one in candidates:
        if one.on is not None and one.on not in nodes:
            node_names = ", ".join(sorted(nodes)) or "none yet, write [[node]]"
            yield f'candidate {one.name}: on names "{one.on}", which is no node; the nodes are: {node_names}'
        for key in ("position_m", "to_m"):
            x_m = getattr(one, key)
            if x_m is not None and x_m > length_m:
                yield (
                    f"candidate {one.name}: {key} = {x_m} m lies beyond the screw's length_m = {length_m} m; "
                    "fix one of them"
                )
        places += 1 if one.spacing_m is None else round((one.to_m - one.from_m) / one.spacing_m) + 1  # type: ignore[operator]
    if places > MOST_PLACES:
        yield f"candidate: {places} places are more than the {MOST_PLACES} that can be tried; try fewer"
        return
    names = [sensor.name for one in candidates for sensor in one.sensors]
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            yield f'{names.count(name)} candidates are called "{name}"; give each its own name'
