"""The key figures of a machine in one case: its steady state, or the maxima of a cycle; for comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from observer.align.aligner import AlignPlan, Position, frames_of_log, refuse_empty
from observer.align.plausibility import Limits
from observer.errors import ConfigError, LogError
from observer.estimate.open_loop import OpenLoop
from observer.estimate.replay import inputs_of, program_of
from observer.files.logs import Log
from observer.forecast.document import travel_of
from observer.frames import BoolArray, FloatArray, Layout
from observer.installation import Installation
from observer.model.build import restraint_on
from observer.model.drive import Drive
from observer.model.realise import realise
from observer.model.rod.screw import biot_number, surface_rate
from observer.model.settle import mean_point, point_of, refuse_drift, settled
from observer.model.survey import NODE, Growth, Survey, displaced, growth_of, survey_of


@dataclass(frozen=True, slots=True)
class CaseFigures:
    """The compared figures of a machine in a case: its steady state, or the maxima over a cycle.

    Attributes:
        name: The variant's name, or the case's.
        position_m: The places along the screw, (g,).
        field_degC: Temperature at these, (g,); over a cycle the highest at each place.
        warmest_degC: Highest temperature of the whole screw, between the places too.
        coldest_degC: Lowest temperature of the whole screw; over a cycle the lowest of the highest ones.
        temperature_degC: By the names of sensors and nodes; over a cycle the highest.
        heat_W: By source; over a cycle the mean. Sources that never give heat are left out.
        error_um: Thermal error, (g,), largest by size; empty without an expansion coefficient.
        force_N: Axial force, largest by size, tension positive.
        largest_error_um: The largest error by size within the travel, with its sign.
        largest_at_m: The place of the largest error.
        slowest_s: Slowest time constant of the coupled machine; None for a cycle.
        biot: Biot number of the screw in the largest film of the case.
    """

    name: str
    position_m: FloatArray
    field_degC: FloatArray
    warmest_degC: float
    coldest_degC: float
    temperature_degC: Mapping[str, float]
    heat_W: Mapping[str, float]
    error_um: FloatArray
    force_N: float
    largest_error_um: float
    largest_at_m: float
    slowest_s: float | None
    biot: float

    @property
    def columns(self) -> dict[str, float]:
        """The figures by the column names of `compare.csv`, such as `heat_nut_W`, `field_250_degC` and
        `biot`.

        Columns of error and force are absent without an expansion coefficient, `slowest_s` is absent for a
        cycle.
        """
        layout = Layout((), self.position_m, (), has_error=bool(len(self.error_um)))
        columns = {f"heat_{name}_W": heat_W for name, heat_W in self.heat_W.items()}
        columns["heat_total_W"] = sum(self.heat_W.values())
        columns |= {f"{name}_degC": value for name, value in self.temperature_degC.items()}
        columns |= {k: float(v[0]) for k, v in layout.along(field__degC=self.field_degC[None]).items()}
        columns |= {"warmest_degC": self.warmest_degC, "coldest_degC": self.coldest_degC}
        if layout.has_error:
            columns |= {k: float(v[0]) for k, v in layout.along(error__um=self.error_um[None]).items()}
            columns |= {"largest_error_um": self.largest_error_um, "largest_at_m": self.largest_at_m}
            columns["force_N"] = self.force_N
        columns["biot"] = self.biot
        return columns if self.slowest_s is None else columns | {"slowest_s": self.slowest_s}


class SurveyedCase(NamedTuple):
    """The figures of a case, and the inputs of a search for a mounting.

    Attributes:
        figures: The compared figures.
        growth: Of the free screw, (K, g) and (K,), µm; None without an expansion coefficient. K is 1 for a
            steady state.
        travel: True where the nuts travel over a place of the grid, (g,).
    """

    figures: CaseFigures
    growth: Growth | None
    travel: BoolArray


def steady_case(
    name: str, config: Installation, inputs: Mapping[str, float], log: Log | None
) -> SurveyedCase:
    """Return the steady state of a machine with constant inputs, or with the mean inputs of a log.

    Args:
        name: The case's name.
        config: The machine.
        inputs: Constant values by channel; they replace channels of the log.
        log: The log whose means are the other inputs; None if `inputs` has all.

    Raises:
        ConfigError: An input is missing or beyond its limits, or the machine has no steady state.
        LogError: A channel that the model needs has no value in the log.
    """
    _refuse_implausible(config, inputs)
    survey = survey_of(config)
    if log is None:
        point = point_of(survey.config, survey.plant, inputs)
    else:
        refuse_drift(config)
        program = with_inputs(log, inputs, survey)
        frames = frames_of_log(program, _plan(survey, inputs))
        point = mean_point(survey.plant, inputs_of(frames, Drive(survey.config, survey.plant)))
    steady = settled(survey.plant, point)
    growth = growth_of(survey, steady.rows[None])
    outcome = _Outcome(steady.rows, growth, steady.heat_W, point.loss_1_s, steady.slowest_s)
    return _case(name, config, survey, outcome)


def cycle_case(name: str, config: Installation, inputs: Mapping[str, float], log: Log) -> SurveyedCase:
    """Return the maxima of a machine's temperature and growth over a log, by its heat laws alone.

    The screw starts at the temperature of the log's first sensor values, or at the ambient.

    Args:
        name: The case's name.
        config: The machine.
        inputs: Constant values by channel; they replace channels of the log.
        log: The cycle, run once.

    Raises:
        ConfigError: An input is beyond its limits.
        LogError: A channel that the model needs has no value in the log.
    """
    _refuse_implausible(config, inputs)
    survey = survey_of(config)
    program = with_inputs(log, inputs, survey)
    loop = OpenLoop(survey.plant, Drive(survey.config, survey.plant))
    hottest, grown = np.full(len(survey.plant.rows.C), -np.inf), list[Growth]()
    heat_J, duration_s, loss_1_s = np.zeros(len(survey.plant.source_names)), 0.0, 0.0
    for frames in frames_of_log(program, _plan(survey, inputs)):
        if (predicted := loop.run(frames)) is not None:
            driven, rows = predicted
            hottest = np.maximum(hottest, rows.max(axis=0))
            if (growth := growth_of(survey, rows)) is not None:
                grown.append(growth)
            heat_J += driven.dt_s @ driven.law_W
            duration_s += float(driven.dt_s.sum())
            loss_1_s = max(loss_1_s, float(driven.loss_1_s.max()))
    if not np.isfinite(hottest).all():
        input_names = ", ".join(c for c in config.channels if c not in config.sensor_channels)
        raise LogError(f"{log.path}: in no row are all inputs known ({input_names}); fill their columns")
    heat_W = heat_J / max(duration_s, 1e-9)
    whole = Growth(*map(np.concatenate, zip(*grown, strict=True))) if grown else None
    return _case(name, config, survey, _Outcome(hottest, whole, heat_W, loss_1_s, None))


def _refuse_implausible(config: Installation, inputs: Mapping[str, float]) -> None:
    """Raise `ConfigError` where a constant input is beyond the limits of a plausible reading."""
    limits = Limits.of(config)
    for channel, value in inputs.items():
        if (doubt := limits.doubt(config.channels.index(channel), value)) is not None:
            raise ConfigError(f"{channel}: {doubt}; give another value, or limits in [limits.{channel}]")


def _plan(survey: Survey, inputs: Mapping[str, float]) -> AlignPlan:
    """Return the plan for a program that holds positions among `inputs`, however fast the screw turns."""
    plan = AlignPlan.of(survey.config)
    positions = [Position(p.column) if plan.channels[p.column] in inputs else p for p in plan.positions]
    return replace(plan, positions=tuple(positions))


def with_inputs(log: Log, inputs: Mapping[str, float], survey: Survey) -> Log:
    """Return the log as a program, with constant `inputs` in place of its own channels of these names.

    Args:
        log: The log, (K, c).
        inputs: Values by channel; channels that the log lacks are added.
        survey: The machine whose channels are needed.

    Raises:
        LogError: A channel that the model needs has no value in any row.
    """
    kept_channels = [c for c in log.channels if c not in inputs]
    columns = [log[c] for c in kept_channels] + [np.full(len(log), value) for value in inputs.values()]
    whole = replace(log, channels=(*kept_channels, *inputs), values=np.column_stack(columns))
    refuse_empty(program := program_of(whole, survey.config), survey.config, sensors=False)
    return program


class _Outcome(NamedTuple):
    """The highest outputs and other results of a case.

    Attributes:
        hottest: highest value of each row of the plant's outputs, (R,), °C.
        growth: of the free screw, None without an expansion coefficient.
        heat_W: mean heat of each source, (m,).
        loss_1_s: largest loss rate that comes with the speed.
        slowest_s: slowest time constant, None for a cycle.
    """

    hottest: FloatArray
    growth: Growth | None
    heat_W: FloatArray
    loss_1_s: float
    slowest_s: float | None


def _case(name: str, config: Installation, survey: Survey, outcome: _Outcome) -> SurveyedCase:
    """Return the figures of a case from its outcome."""
    plant, g, hottest, growth = survey.plant, len(survey.grid_m), outcome.hottest, outcome.growth
    field_degC = hottest[plant.rows.field_slice]
    travel = travel_of(config, survey.grid_m)
    error_um, force_N, largest, at = np.zeros((0,)), 0.0, 0.0, 0
    if growth is not None:
        errors, forces = displaced(restraint_on(config, survey.grid_m), growth)
        error_um, force_N = largest_of(errors), float(largest_of(forces[:, None])[0])
        at = int(np.argmax(np.where(travel, np.abs(error_um), -1.0)))
        largest = float(error_um[at])
    names = [s.name.removeprefix(NODE) for s in survey.config.sensor]
    machine = realise(survey.config).config
    heat_sources = {s.name for s in machine.source if s.law != "heat_W" or s.heat_W}
    film_W_m2K = machine.surface.convection_W_m2K + outcome.loss_1_s / surface_rate(machine.screw)
    figures = CaseFigures(
        name=name,
        position_m=survey.grid_m,
        field_degC=field_degC[:g],
        warmest_degC=float(field_degC.max()),
        coldest_degC=float(field_degC.min()),
        temperature_degC=dict(zip(names, hottest[plant.rows.sensor_slice].tolist(), strict=True)),
        heat_W={
            n: w
            for n, w in zip(plant.source_names, outcome.heat_W.tolist(), strict=True)
            if n in heat_sources
        },
        error_um=error_um,
        force_N=force_N,
        largest_error_um=largest,
        largest_at_m=float(survey.grid_m[at]),
        slowest_s=outcome.slowest_s,
        biot=biot_number(machine.screw, film_W_m2K),
    )
    return SurveyedCase(figures, growth, travel)


def largest_of(values: FloatArray) -> FloatArray:
    """Return the value of each column (K, c) that is largest by size, (c,), with its sign."""
    return np.asarray(values[np.abs(values).argmax(axis=0), np.arange(values.shape[1])])


def as_document(figures: CaseFigures) -> dict[str, Any]:
    """Return the figures as in `steady.json` and `compare.json`.

    Error, its place and the force are None without an expansion coefficient, arrays are lists.
    """
    with_error = bool(len(figures.error_um))
    return {
        "name": figures.name,
        "heat_W": dict(figures.heat_W),
        "temperature_degC": dict(figures.temperature_degC),
        "position_m": figures.position_m.tolist(),
        "field_degC": figures.field_degC.tolist(),
        "warmest_degC": figures.warmest_degC,
        "coldest_degC": figures.coldest_degC,
        "error_um": figures.error_um.tolist() if with_error else None,
        "largest_error_um": figures.largest_error_um if with_error else None,
        "largest_at_m": figures.largest_at_m if with_error else None,
        "force_N": figures.force_N if with_error else None,
        "slowest_s": figures.slowest_s,
        "biot": figures.biot,
    }
