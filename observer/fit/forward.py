"""The open-loop prediction of several runs for any configuration, as fast as a search needs it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config.effects.terms import Body
from observer.config.machine import Config, untied
from observer.config.sections import Source, owner
from observer.fit.bend import Bend, unbent
from observer.fit.runs import TICK_S, Run, driven, mean_over
from observer.fit.steps import Cache, SteppedRun, driving
from observer.frames import FloatArray, Inputs
from observer.model.build import build_plant
from observer.model.plant import Plant
from observer.model.realise import terms_of
from observer.model.simulate import Means, simulate_means, start_from_sensors

OUTAGE_S, OUTAGE_ROWS, MOST_OUTAGES = 30.0, 2.5, 12
"""An outage is longer than this time and this number of usual row distances; only the longest count."""
SWITCHED, MOST_SWITCHES = 0.1, 24
"""Relative change of a source's usual heat that counts as a switch, and the largest number in a log."""
STRETCHES, STRETCH_SHARE = 8, 0.3
"""Number of stretches of the screw that an outage may have heated, and their heat.

The heat is relative to the usual heat of the strongest source.
"""
WANDERS = 0.7
"""Uncertain part of a nut's heat on a stretch where rows are too far apart to follow its path."""
MOST_KEPT = 8
PREDICTS = {
    "screw", "surface", "ambient", "boundary", "source", "node", "link", "sensor", "model", "estimator",
    "output", "supports", "bed",
}  # fmt: skip
"""The sections of a configuration that a prediction depends on, beside the effects."""


class Forward:
    """Predicts the means of each run open loop; the number of modes is that of the initial configuration.

    Results that depend only on the runs are computed once, those that depend on parameters are cached. A
    prediction with other heats costs a simulation. One with another film also costs the building of a plant.

    Args:
        config: The machine; it fixes the number of modes and the tables of moving nuts.
        runs: The prepared logs.
        watch: Called with every prediction. None calls nothing.
        tick_s: Length of a tick, s (see `steps`); 0 predicts row by row.

    Attributes:
        runs: The runs in the steps of a prediction.
    """

    def __init__(
        self,
        config: Config,
        runs: Sequence[Run],
        watch: Callable[[list[FloatArray]], None] | None = None,
        *,
        tick_s: float = TICK_S,
    ) -> None:
        self._watch, self._by_row = watch, tick_s == 0.0
        config = untied(config)
        plant = build_plant(config).sensors_only()
        self._modes, self._bent = plant.modes - plant.bent, plant.bent
        self._tables = [m.table for m in plant.moving]
        self._shows = np.array([s.shows for s in config.sensor])
        self.runs = tuple(SteppedRun(run, config, plant, tick_s=tick_s) for run in runs)
        self._plants, self._means = Cache[Plant](MOST_KEPT), Cache[list[FloatArray]](MOST_KEPT)

    def __call__(self, config: Config) -> list[FloatArray]:
        """Return the predicted means of each run, (b, s), °C, or µm of a displacement.

        Args:
            config: Any machine with the sensors of the initial one. An absurd one gives infinite values or
                NaN without a warning.
        """
        setting = self._setting(config)
        means = self._means.get((setting.key, setting.strength.tobytes()), lambda: self._predict_all(setting))
        if self._watch is not None:
            self._watch(means)
        return means

    def heats_W(self, config: Config) -> list[FloatArray]:
        """Return the heats by law of each run, averaged over its means, W, (b, m), with m sources of the
        plant.
        """
        setting, out = self._setting(config), []
        for run in self.runs:
            ticks, law_W = run.ticks, self._inputs(setting, run).law_W
            starts = np.flatnonzero(np.diff(ticks.mean, prepend=-1))
            out.append(mean_over(law_W, ticks.length_s, starts))
        return out

    def _setting(self, config: Config) -> Setting:
        """The inputs of a prediction of the runs at a configuration."""
        unit, strength = unit_laws(lean_config(config, self._modes))
        key = unit.model_dump_json(include=PREDICTS) + repr(unit.effect)
        unit, bend = unbent(unit)
        plant = self._plants.get(key, lambda: self._plant(unit))
        return Setting(unit, key, strength, plant, driving(unit), bend)

    def _plant(self, config: Config) -> Plant:
        if self._by_row:
            return build_plant(config).sensors_only()
        shown = np.array([s.shows for s in config.sensor][: len(self._shows)]) / self._shows
        return self._with_tables(build_plant(config, nut_places=2).sensors_only(), shown)

    def _predict_all(self, setting: Setting) -> list[FloatArray]:
        with np.errstate(over="ignore", invalid="ignore"):  # a hypothesis may be absurd
            return [self._predict(setting, run) for run in self.runs]

    def by_outages(self, config: Config) -> list[list[FloatArray]]:
        """Return the changes of the predictions by an unknown heat in each outage.

        Inputs of an outage are unknown: a heat may have been on, off, elsewhere or later. Each source counts
        throughout the outage. A heat on each stretch of the screw counts throughout and at the end. At most
        twelve outages of a log count, the longest.

        Args:
            config: The machine.

        Returns:
            For each such heat its change of all predictions, (b, s) by run, in K or µm; empty without an
            outage.
        """
        if not any(len(outages_of(run)) for run in self.runs):
            return []
        setting, bands = self._with_stretches(config)
        unchanged, changes = self._predict_all(setting), list[list[FloatArray]]()
        stretch = np.isin(np.arange(len(setting.plant.source_names)), [j for j, _ in bands])
        for i, run in enumerate(self.runs):
            law_W, length_s = self._inputs(setting, run).law_W, run.ticks.length_s
            usual_W = np.quantile(np.abs(law_W), 0.9, axis=0)
            usual_W[stretch] = STRETCH_SHARE * usual_W.max()
            outages = outages_of(run)
            longest = outages[np.argsort(-length_s[outages])][:MOST_OUTAGES]
            for tick in longest.tolist():
                after = min(tick + 1, len(law_W) - 1)
                all_at_once = length_s[tick] / max(length_s[after], 1.0)
                for at, sources, share in ((tick, usual_W > 0, 1.0), (after, stretch, all_at_once)):
                    for j in np.flatnonzero(sources).tolist():
                        more_W = np.zeros_like(law_W)
                        more_W[at, j] = share * usual_W[j]
                        changes.append(self._with_more(setting, i, more_W, unchanged))
        return changes

    def fields(self, config: Config, positions_m: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Return the predicted temperature along the screw.

        Args:
            config: The machine.
            positions_m: Positions on the screw, m, (P,).

        Returns:
            For each run the temperature at the ends of its T steps, (T, P), and the ambient, (T,), both in
            °C.
        """
        like = config.sensor[0].model_copy(update={"position_m": 0.0, "on": None})
        places = [
            like.model_copy(update={"name": f"place.{i}", "position_m": x})
            for i, x in enumerate(positions_m.tolist())
        ]
        unit, strength = unit_laws(lean_config(config, self._modes))
        unit = unit.model_copy(update={"sensor": (*unit.sensor, *places)})
        plant = build_plant(unit, nut_places=2).sensors_only()
        key = f"fields {unit.model_dump_json(include=PREDICTS)}"
        setting = Setting(unit, key, strength, plant, driving(unit))
        with np.errstate(over="ignore", invalid="ignore"):
            rows = [self._rows(setting, run) for run in self.runs]
        ambient = plant.known.ambient
        return [(values.ends[:, -len(places) :], inputs.z_end[:, ambient]) for inputs, values in rows]

    def by_coarse_rows(self, config: Config) -> list[list[FloatArray]]:
        """Return the changes of the predictions that rows far apart leave undetermined.

        Unknown are the time between two rows at which heats changed, and the part of the heat that a nut left
        on each stretch of its path.

        Args:
            config: The machine.

        Returns:
            For each unknown one standard deviation of its change of all predictions, (b, s) by run. Empty if
            no run has rows far apart.
        """
        if not any(run.coarse for run in self.runs):
            return []
        setting, bands = self._with_stretches(config)
        unchanged, changes = self._predict_all(setting), list[list[FloatArray]]()
        for i, run in enumerate(self.runs):
            if run.coarse:
                open_W = _undetermined(run, setting.plant, self._inputs(setting, run), bands)
                changes += [self._with_more(setting, i, more_W, unchanged) for more_W in open_W]
        return changes

    def _with_stretches(self, config: Config) -> tuple[Setting, list[tuple[int, Source]]]:
        """The setting with a source on each stretch of the screw, and these with their numbers among all."""
        stretches = _stretches(config)
        setting = self._setting(config.model_copy(update={"source": (*config.source, *stretches)}))
        return setting, [(setting.plant.source_names.index(s.name), s) for s in stretches]

    def _with_more(
        self, setting: Setting, i: int, more_W: FloatArray, unchanged: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """The change (b, s) of each prediction with heats (T, m) beside those of run i."""
        change = [np.zeros_like(h) for h in unchanged]
        change[i] = self._predict(setting, self.runs[i], more_W) - unchanged[i]
        return change

    def airs(self, config: Config) -> list[FloatArray]:
        """Return the air temperature of each run over every sensor's means, (b, s), °C."""
        setting, out = self._setting(config), []
        for run in self.runs:
            air = self._inputs(setting, run).z_end[:, setting.plant.known.ambient]
            ticks, of_mean = run.ticks.mean, run.ticks.measured_degC
            mean = np.bincount(ticks, air, len(of_mean)) / np.maximum(np.bincount(ticks), 1)
            out.append(np.broadcast_to(mean[:, None], of_mean.shape))
        return out

    def _with_tables(self, plant: Plant, shown: FloatArray) -> Plant:
        """Return the plant with the first one's tables of moving nuts, scaled.

        The part of the dropped modes scales with 1/kA, independent of the film. It also scales with the share
        of the rise that each sensor shows, relative to the first plant, (s,).
        """
        moving = []
        for m, first in zip(plant.moving, self._tables, strict=True):
            ratio = shown * (first.conductance_W_m / m.table.conductance_W_m)
            table_C, mean_C = first.table_C * ratio, first.mean_C * ratio
            table = m.table  # columns independent of the nut's position, as of lagging sensors, stay
            same = (table.table_C == table.mean_C).all(axis=0)
            table_C[:, same], mean_C[same] = table.mean_C[same], table.mean_C[same]
            if plant.bent != self._bent:  # its own modes hold what the first one's lag shows
                table_C, mean_C = table_C + (table.mean_C - mean_C), table.mean_C
            moving.append(m.with_table(table_C=table_C, mean_C=mean_C))
        return replace(plant, moving=tuple(moving))

    def _inputs(self, setting: Setting, run: SteppedRun) -> Inputs:
        """The inputs of a run, its laws scaled to their strengths; those added by effects and links are
        unscaled.
        """
        inputs = run.inputs(setting.config, setting.plant, setting.key, setting.driving)
        added = np.ones(inputs.law_W.shape[1] - len(setting.strength))
        strength = np.concatenate([setting.strength, added])
        return inputs._replace(law_W=inputs.law_W * strength, law_jump_W=inputs.law_jump_W * strength)

    def _predict(self, setting: Setting, run: SteppedRun, more_W: FloatArray | None = None) -> FloatArray:
        inputs, values = self._rows(setting, run, more_W)
        if setting.bend is None:
            return run.means(setting.plant, inputs, values)
        rows = setting.plant.rows
        plant = replace(
            setting.plant, rows=replace(rows, C=rows.C[:-1], F=rows.F[:-1], sensors=rows.sensors - 1)
        )
        return run.means(plant, inputs, setting.bend.of(values))

    def _rows(
        self, setting: Setting, run: SteppedRun, more_W: FloatArray | None = None
    ) -> tuple[Inputs, Means]:
        """The inputs of a run's steps, and the output rows (T, R) of these.

        Rows beyond the run's own sensors have no initial readings.
        """
        plant, inputs = setting.plant, self._inputs(setting, run)
        if more_W is not None:
            inputs = inputs._replace(law_W=inputs.law_W + more_W)
        unread = np.full(plant.rows.sensors - len(run.run.start_degC), np.nan)
        start_degC, start_R_K2 = (
            np.concatenate([readings, unread]) for readings in (run.run.start_degC, run.run.start_R_K2)
        )
        state = start_from_sensors(plant, start_degC, start_R_K2, inputs.law_W[0], inputs.z_start[0])
        sweep = run.sweep(plant)
        return inputs, simulate_means(
            plant if sweep is None else _without_sweeps(plant), state, inputs, sweep
        )


def outages_of(run: SteppedRun) -> NDArray[np.int64]:
    """Return the ticks of a run that are outages.

    They are longer than 30 s and than two and a half of the usual distances between rows.
    """
    return np.flatnonzero(run.ticks.length_s > max(OUTAGE_S, OUTAGE_ROWS * run.row_s))


def _undetermined(
    run: SteppedRun, plant: Plant, inputs: Inputs, bands: Sequence[tuple[int, Source]]
) -> Iterator[FloatArray]:
    """Yield changes of the heats by law, W, (T, m), that rows far apart leave undetermined.

    In a prediction a heat changes evenly from one row to the next. All heats may instead have changed at the
    one row, or all at the other, as the recorder has it. Each may also have changed at any time between.

    Args:
        run: A run with rows far apart.
        plant: The model.
        inputs: Inputs of the ticks.
        bands: Stretches of the screw, each with its number among the sources.
    """
    law_W, jump_W = inputs.law_W, inputs.law_jump_W
    usual_W = np.maximum(np.quantile(np.abs(law_W), 0.9, axis=0), 1e-9)
    size = np.max(np.abs(jump_W) / usual_W, axis=1)
    largest = np.argsort(-size)[:MOST_SWITCHES]
    switches = np.sort(largest[size[largest] > SWITCHED])
    if len(switches):
        yield 0.5 * jump_W
    for tick in switches.tolist():
        more_W = np.zeros_like(law_W)
        more_W[tick] = jump_W[tick] / np.sqrt(12.0)  # standard deviation of a uniform distribution
        yield more_W
    parts = np.split(np.arange(len(law_W)), switches)
    for nut in plant.moving:
        if driven(run.run.frames.path[nut.channel]):
            continue
        place_m = run.run.frames.path[nut.channel].position_m
        low_m, high_m = np.nanmin(place_m), np.nanmax(place_m)
        under = [j for j, s in bands if (s.to_m or 0.0) > low_m and (s.from_m or 0.0) < high_m]
        running = [part for part in parts if np.any(law_W[part, nut.index])]
        for part, j in itertools.product(running, under):
            more_W = np.zeros_like(law_W)
            moved_W = WANDERS / len(under) * law_W[part, nut.index]
            more_W[part, j] = moved_W
            more_W[part[:, None], under] -= moved_W[:, None] / len(under)  # from all along its path
            yield more_W


class Setting(NamedTuple):
    """A configuration ready for predictions.

    Attributes:
        config: The configuration with laws of strength 1, without play in its supports.
        key: Key of everything but the strengths, for caches.
        strength: Factors on the laws, (m,).
        plant: The model, reduced to the sensors' rows.
        driving: Key of everything that determines the inputs.
        bend: Play in the supports, or None.
    """

    config: Config
    key: str
    strength: FloatArray
    plant: Plant
    driving: str
    bend: Bend | None = None


def _without_sweeps(plant: Plant) -> Plant:
    """The plant without its own spreads of moving nuts, since the sweeps are known."""
    c = plant.coupling
    s = c.spreads
    s = s._replace(first=np.zeros_like(s.first), rate_1_s=s.rate_1_s[:0], row=s.row[:0], into=s.into[:0])
    return replace(plant, coupling=c._replace(spreads=s))


def lean_config(config: Config, modes: int) -> Config:
    """Return the same screw with a minimum of output rows and a fixed number of modes.

    With a varying number of modes, the misfit would jump from one film value to the next. Without
    displacement sensors the thermal error is left out.

    Args:
        config: The machine.
        modes: Number of modes under the tail criterion; a configured number or another criterion stays.
    """
    model = config.model
    if model.criterion == "tail" and model.modes is None:
        model = model.model_copy(update={"modes": modes})
    output = config.output.model_copy(update={"positions_m": (0.0, config.screw.length_m)})
    lean = config.model_copy(update={"output": output, "model": model})
    if any(sensor.kind == "displacement" for sensor in config.sensor):
        return lean
    screw = config.screw.model_copy(update={"expansion_1_K": None})
    output = output.model_copy(update={"reference_degC": 0.0})
    without_sections = {"supports": None, "bed": None}
    return lean.model_copy(update={"output": output, "screw": screw, **without_sections})


def _stretches(config: Config) -> list[Source]:
    """Sources that lie end to end along the screw, without a heat of their own."""
    edges_m = np.linspace(0.0, config.screw.length_m, STRETCHES + 1).tolist()
    return [
        Source(name=f"stretch-{i + 1}", shape="band", from_m=a, to_m=b, heat_W=0.0)
        for i, (a, b) in enumerate(itertools.pairwise(edges_m))
    ]


def unit_laws(config: Config) -> tuple[Config, FloatArray]:
    """Return the configuration with heat laws of strength 1, and their strengths.

    Args:
        config: The machine.

    Returns:
        The configuration, in which no law follows another. Factors (m,) with which each source's heat must be
        multiplied.
    """
    config = untied(config)
    divided = {t.source for t in terms_of(config) if isinstance(t, Body) and t.heated > 0.0}
    sources = [s.model_copy(update=dict.fromkeys(_linear_in(s, divided), 1.0)) for s in config.source]
    strength = [_strength(source, config, divided) for source in config.source]
    return config.model_copy(update={"source": tuple(sources)}), np.array(strength)


def _linear_in(source: Source, divided: Collection[str]) -> tuple[str, ...]:
    """The parameters that only scale a source's law; for `divided` sources the share does more."""
    share = () if source.name in divided else ("share",)
    if source.torque_Nm is not None and source.nut_torque_Nm is None:
        return ("scale", *share, "torque_Nm")
    if source.law in ("torque_Nm", "bearing", "nut_friction"):
        return ("scale", *share)
    if source.heat_W_rpm is not None:
        return ("scale", "heat_W_rpm")
    return ("scale", "heat_ratio") if source.law == "heat_of" else ("scale",)


def _strength(source: Source, config: Config, divided: Collection[str]) -> float:
    """The factor on the law of strength 1."""
    if source.law == "heat_of":
        other = _strength(owner(source, config.source), config, divided)
        return source.scale / (source.heat_ratio or 1.0) * other
    return math.prod(float(getattr(source, key)) for key in _linear_in(source, divided))
