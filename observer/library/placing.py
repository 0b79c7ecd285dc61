"""Finds sensors that are worth their cost: candidates, the search over their sets, and the σ that remain."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from observer.config.machine import Config
from observer.config.sections import AMBIENT
from observer.config.sensors import Sensor
from observer.errors import UserError, check_choice
from observer.estimators.design.placing import SetLimits, best_sets
from observer.estimators.design.spread import NotDefined, SensorSet, Spread, spread, with_sensors
from observer.forecast.document import travel_of
from observer.frames import BoolArray, FloatArray
from observer.installation import Installation, load_candidates, parse_candidates
from observer.library.packages import in_words
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.report.sensitivity import few_modes

GivenCandidates = str | Path | Sequence[Mapping[str, Any]] | None
"""A file of candidates, their tables, or None for those of the configuration."""
Quantity = Literal["all", "heat", "field", "error"]
"""The criterion for a set of sensors."""
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
DEFAULT_PLACES = 41
"""Number of positions along a screw if no candidates are given."""
SEARCH_STEP_S, LINKED_STEP_S = 20.0, 10.0
"""Steps over the shift to rank many sets, and those of a machine with bodies linked to a nut. The few sets
that are shown have shorter ones.
"""
_SETS_AT_ONCE = 32  # sets evaluated at once
_MORE_THAN_HEATS = 2  # how many more sensors than heats are tried by default


@dataclass(frozen=True, slots=True)
class SensorPlaces:
    """A set of sensors and the σ that remain with it, means over the standard shift.

    Field and thermal error are over the travel of the nuts, or the whole screw where none travels.

    Attributes:
        names: Names of the candidates.
        positions_m: Where they are on the screw; None for one beside it.
        cost: Of the set, in the unit of the candidates' costs; configured sensors that stay are free.
        heat_sigma_W: By source.
        field_sigma_K: As rms over the places.
        field_worst_K: At the worst place.
        error_sigma_um: As rms over the places; None without an expansion coefficient.
        error_worst_um: At the worst place; None without an expansion coefficient.
    """

    names: tuple[str, ...]
    positions_m: tuple[float | None, ...]
    cost: float
    heat_sigma_W: Mapping[str, float]
    field_sigma_K: float
    field_worst_K: float
    error_sigma_um: float | None
    error_worst_um: float | None

    def document(self) -> dict[str, Any]:
        """Return the set as `observer place --json` prints it, with the attributes as its keys."""
        return {name: _plain(getattr(self, name)) for name in self.__slots__}


@dataclass(frozen=True, eq=False, repr=False)
class PlacedSensors:
    """The sets of sensors of which none is both cheaper and better, the cheapest first.

    Attributes:
        sets: These sets; each is better than all cheaper ones.
        configured: The configuration's own sensors, at no cost.
        by: The criterion.
        exhaustive: True if all sets were tried, False after a greedy search with exchanges.
        tried: Number of sets tried.
    """

    sets: tuple[SensorPlaces, ...]
    configured: SensorPlaces
    by: Quantity
    exhaustive: bool
    tried: int

    @property
    def document(self) -> dict[str, Any]:
        """The content of `observer place --json`."""
        return {
            "by": self.by,
            "exhaustive": self.exhaustive,
            "tried": self.tried,
            "configured": self.configured.document(),
            "sets": [one.document() for one in self.sets],
        }

    @in_words
    def draw(self, path: str | Path) -> None:
        """Draw the σ that remain against the cost into a file.

        Args:
            path: Its suffix chooses the format: .png, .svg or .pdf.

        Raises:
            UserError: The folder cannot be written, or matplotlib is not installed.
        """
        from observer.report.placing import write_costs

        write_costs(Path(path), self.document)

    def __repr__(self) -> str:
        return "\n".join(f"{one.cost:g}: {', '.join(one.names)}" for one in self.sets)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"


@dataclass(frozen=True, slots=True)
class Choice:
    """The options of a search.

    Attributes:
        sensors: Largest number of sensors in a set; None for any within a budget, else two more than heats.
        budget: Largest cost of a set; None for any.
        by: The criterion.
        keep: Whether the configured sensors stay in every set, and count.
    """

    sensors: int | None = None
    budget: float | None = None
    by: Quantity = "all"
    keep: bool = False


class Mountable(NamedTuple):
    """A sensor that could be mounted.

    Attributes:
        sensor: Its place, noise and tolerances.
        cost: In any unit that all candidates share.
        every_s: Interval of its readings if it is probed; None for a reading each step.
    """

    sensor: Sensor
    cost: float
    every_s: float | None = None


def placed(
    config: Config, candidates: Sequence[Mountable], choice: Choice, progress: Callable[[str], None]
) -> PlacedSensors:
    """Return the sets of candidates that leave the smallest σ for their cost.

    Sets are ranked with long steps over the standard shift; the σ of the sets returned have shorter ones.

    Args:
        config: The machine; its sensors are the set `configured`.
        candidates: The sensors that could be mounted.
        choice: The limits of a set, and the criterion.
        progress: Receives the stage of the work.

    Raises:
        UserError: No set fulfils the choice, or the thermal error or a displacement is asked for without an
            expansion coefficient.
    """
    check_choice("by", choice.by, QUANTITIES)
    if choice.by == "error" and config.screw.expansion_1_K is None:
        raise UserError("place: --by error needs the screw's expansion coefficient; give screw.expansion_1_K")
    moved = [one.sensor.name for one in candidates if one.sensor.kind == "displacement"]
    if moved and config.screw.expansion_1_K is None:
        raise UserError(
            f"place: candidate {moved[0]}: a displacement needs the screw's expansion coefficient; give "
            "screw.expansion_1_K"
        )
    bench = _Bench.of(config, candidates)
    limits = _limits(bench, len(config.sensor), [one.cost for one in candidates], choice)
    step_s = LINKED_STEP_S if len(bench.plant.coupling.links.source) else SEARCH_STEP_S
    tried = 0

    def score(sets: Sequence[SensorSet]) -> FloatArray:
        nonlocal tried
        scores = []
        for i in range(0, len(sets), _SETS_AT_ONCE):
            progress(f"{tried} sets of sensors tried")
            part = sets[i : i + _SETS_AT_ONCE]
            scores.append(bench.judged(bench.sigmas(part, step_s), choice.by))
            tried += len(part)
        return np.concatenate(scores)

    front = best_sets(score, limits)
    progress("working out what remains")
    configured = tuple(range(len(candidates), len(candidates) + len(config.sensor)))
    shown_sets = [*front.sets, configured]
    sigmas = bench.sigmas(shown_sets, None)
    places = [bench.places(one, limits.cost(one), sigmas, v) for v, one in enumerate(shown_sets)]
    return PlacedSensors(tuple(places[:-1]), places[-1], choice.by, front.exhaustive, front.tried)


@dataclass(frozen=True, slots=True)
class _Bench:
    """A plant with every candidate as a sensor, followed by the configured sensors.

    `on_laws` is the plant for sets without a thermocouple on the screw, whose estimates also rest on heat
    laws.
    """

    config: Config
    plant: Plant
    on_laws: Plant
    sensors: tuple[Sensor, ...]
    every_s: FloatArray
    travelled: BoolArray

    @classmethod
    def of(cls, config: Config, candidates: Sequence[Mountable]) -> _Bench:
        """Return the bench of a configuration; candidates are renamed, as they may share a configured
        sensor's name.
        """
        candidate_sensors = [
            one.model_copy(update={"name": f"candidate {one.name}", "channel": f"candidate {one.channel}"})
            for one, _, _ in candidates
        ]
        period_s = config.estimator.period_s
        often_s = [one.every_s or period_s for one in candidates]
        often_s += config.reading_s.tolist()
        kalman = config.estimator.model_copy(update={"kind": "kalman", "engine": "compiled"})
        updates = {"sensor": (*candidate_sensors, *config.sensor), "estimator": kalman}
        config = few_modes(config.model_copy(update=updates))
        plant = build_plant(config, learns=True)
        return cls(
            config,
            plant,
            build_plant(config.resting_on_laws(), learns=True) if config.screw_is_seen else plant,
            (*(one.sensor for one in candidates), *config.sensor[len(candidate_sensors) :]),
            np.array(often_s),
            travel_of(config, plant.layout.position_m),
        )

    def sigmas(self, sets: Sequence[SensorSet], dt_s: float | None) -> Spread:
        """Return the σ over the shift with each of the sets, as a configuration with only these sensors
        has them; `dt_s` is that of `spread`.
        """
        plants, every_s = [], np.full((len(sets), len(self.sensors)), math.inf)
        for chosen, row in zip(sets, every_s, strict=True):
            sees_screw = any(self.sensors[i].sees_the_screw for i in chosen)
            plants.append(with_sensors(self.plant if sees_screw else self.on_laws, chosen))
            row[list(chosen)] = self.every_s[list(chosen)]
        sigmas = spread(self.config, plants, every_s, dt_s)
        if isinstance(sigmas, NotDefined):
            raise UserError(f"place: σ is not computed: {sigmas.reason}")
        return sigmas

    def judged(self, sigmas: Spread, by: Quantity) -> FloatArray:
        """Return one number for each set, (v,): a quantity's rms σ, or the geometric mean of the σ of all
        three.
        """
        rms: dict[str, FloatArray] = {
            "heat": _rms(sigmas.heat_W),
            "field": _rms(sigmas.field_K[:, self.travelled]),
        }
        if sigmas.error_um.size:
            rms["error"] = _rms(sigmas.error_um[:, self.travelled])
        if by != "all":
            return rms[by]
        return np.asarray(np.exp(np.mean([np.log(sigma) for sigma in rms.values()], axis=0)))

    def places(self, chosen: SensorSet, cost: float, sigmas: Spread, v: int) -> SensorPlaces:
        """Return set `v` of the evaluated ones with its names, positions and σ."""
        field_K = sigmas.field_K[v, self.travelled]
        error_um = sigmas.error_um[v, self.travelled] if sigmas.error_um.size else None
        return SensorPlaces(
            names=tuple(self.sensors[i].name for i in chosen),
            positions_m=tuple(self.sensors[i].position_m for i in chosen),
            cost=cost,
            heat_sigma_W=dict(zip(self.plant.layout.sources, sigmas.heat_W[v].tolist(), strict=True)),
            field_sigma_K=float(_rms(field_K)),
            field_worst_K=float(field_K.max()),
            error_sigma_um=None if error_um is None else float(_rms(error_um)),
            error_worst_um=None if error_um is None else float(error_um.max()),
        )


def candidates_of(
    config: Installation, candidates: GivenCandidates, spacing_m: float | None
) -> list[Mountable]:
    """Return the sensors that could be mounted: `candidates`, else those of the configuration.

    Without any they are the nodes in contact with air, and places along the screw. If all sensors are on
    nodes, places on the screw are left out unless a spacing is given.

    Args:
        config: The machine; its first thermocouple is the pattern of sensors that are made up.
        candidates: A file of `[[candidate]]`, or its tables.
        spacing_m: Distance of the places on the screw; None for 41 places.

    Raises:
        UserError: A spacing is given together with candidates.
        ConfigError: A candidate is invalid.
    """
    if candidates is None:
        tables = config.candidate
    elif isinstance(candidates, str | Path):
        tables = load_candidates(Path(candidates), config)
    else:
        tables = parse_candidates({"candidate": list(candidates)}, "candidates", config)
    if tables:
        if spacing_m is not None:
            raise UserError(
                "place: --spacing-m is for use without candidates; give spacing_m "
                "to the [[candidate]] instead"
            )
        return [Mountable(sensor, one.cost, one.probing_s) for one in tables for sensor in one.sensors]
    thermocouples = [s for s in config.sensor if s.kind == "temperature"]
    template = thermocouples[0]
    sensors = []
    for node in _in_the_air(config):
        sensors.append(
            template.model_copy(update={"name": node, "channel": node, "position_m": None, "on": node})
        )
    if spacing_m is not None or not sensors or any(s.position_m is not None for s in thermocouples):
        length_m = config.screw.length_m
        points = DEFAULT_PLACES if spacing_m is None else max(2, round(length_m / spacing_m) + 1)
        for x_m in np.linspace(0.0, length_m, points).round(6).tolist():
            name = f"{1000 * x_m:g}mm"
            sensors.append(
                template.model_copy(update={"name": name, "channel": name, "position_m": x_m, "on": None})
            )
    return [Mountable(sensor, 1.0) for sensor in sensors]


def _in_the_air(config: Config) -> list[str]:
    """Return the names of the nodes in contact with air, or of all nodes if none is."""
    touched = {end for link in config.link if AMBIENT in link.between for end in link.between}
    names = [node.name for node in config.node]
    return [name for name in names if name in touched] or names


def _limits(bench: _Bench, configured: int, costs: Sequence[float], choice: Choice) -> SetLimits:
    """Return the limits of the search. Raises `UserError` where no set of sensors can be within them."""
    n, budget, stay = len(costs), choice.budget, configured if choice.keep else 0
    if choice.sensors is not None and not stay < choice.sensors <= stay + n:
        count_too = f" beside {stay} configured ones, which stay and count too" if stay else ""
        raise UserError(
            f"place: {choice.sensors} sensors cannot stand on {n} candidate positions{count_too}; ask for "
            f"{stay + 1} to {stay + n}, or name more candidates"
        )
    if choice.sensors is not None:
        largest_count = choice.sensors - stay
    else:
        largest_count = (
            n if budget is not None else min(n, int(bench.plant.estimated.sum()) + _MORE_THAN_HEATS)
        )
    thermal = frozenset(i for i, one in enumerate(bench.sensors) if one.kind == "temperature")
    first = min((costs[i] for i in thermal if i < n), default=None)
    if first is None and not choice.keep:
        raise UserError(
            "place: no candidate measures a temperature, from which an estimate starts; name a thermocouple, "
            "or keep the configured sensors (--keep)"
        )
    if budget is not None and first is not None and not choice.keep and first > budget:
        raise UserError(
            f"place: a budget of {budget:g} buys no thermocouple, of which the cheapest costs {first:g}; "
            "give more, or name cheaper candidates"
        )
    configured_indices = tuple(range(n, n + configured))
    all_costs = np.array([*costs, *[0.0] * configured])
    most_cost = math.inf if budget is None else budget
    return SetLimits(
        all_costs,
        tuple(range(n)),
        largest_count,
        most_cost,
        configured_indices if choice.keep else (),
        thermal,
    )


def _rms(sigma: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(sigma**2, axis=-1)))


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    return dict(value) if isinstance(value, Mapping) else value
