"""The reduced observer of a configuration as a form: its constants, inputs, outputs and state."""

from __future__ import annotations

import math
from importlib.metadata import version
from typing import Any

import numpy as np

from observer.align.plausibility import Limits
from observer.config.machine import Config
from observer.control.compensation import LATE_PERIODS, plan_of
from observer.export import sequence
from observer.export.exportable import refuse_unexportable
from observer.export.form import Form, Kind, Role, Slot, identifiers
from observer.export.gain_sets import LONG, GainSets, gain_sets
from observer.export.laws import law_terms
from observer.frames import Layout
from observer.kernels.judging import RELEASE_AFTER_STEPS, STALE_AFTER_STEPS
from observer.model.build import build_plant, grid_of
from observer.model.discretise import StepMatrices, quantise, step_matrices
from observer.model.drive import Drive
from observer.model.plant import MovingSource
from observer.model.rod.moving import TABLE_POINTS, columns_at
from observer.units import unit_of

UNLIMITED = 1e30
_STALE_PERIODS = 2.0
"""An input is stale when it is older than so many of its periods, as in the aligner."""
_MOST_POINTS = 64
_SANE = 1e6
"""A state beyond this (K, W) is invalid; the observer then restarts."""
_PARTS_OF_NUT = 4
"""Of its length, as far apart as the places at most for which a nut's columns are tabulated."""


class Exportable:
    """A configuration with its plant, drive and step, if it can be exported.

    Attributes:
        config: The configuration.
        plant: Its plant, with constant matrices beside those of moving nuts.
        drive: Turns channels into heats and known inputs.
        period_s: The step of the exported code in s: `estimator.period_s`, rounded as the service rounds it.
        step: The plant's exact step of that length.
    """

    def __init__(self, config: Config) -> None:
        """Build plant, drive and step.

        Args:
            config: A checked configuration.

        Raises:
            ConfigError: If a controller cannot follow the model, with the key and the remedy.
        """
        refuse_unexportable(config)
        self.config = config
        self.plant = build_plant(config)
        self.drive = Drive(config, self.plant)
        self.drive.set_channels(config.channels)
        refuse_unexportable(config, self.plant, self.drive)
        self.period_s = float(quantise(np.array(config.estimator.period_s)))
        self.step: StepMatrices = step_matrices(self.plant, self.period_s)

    def form(self, name: str, constants: dict[str, Any], slots: list[Slot], parts: Any, facts: Any) -> Form:
        """Return a form of this machine, with its name, digest of the configuration, version and period.

        Args:
            name: `observer` or `model`.
            constants: Integers, floats and arrays by name.
            slots: All inputs, outputs and arrays that the parts use.
            parts: Functions of `algorithm` and `sequence` in the order of their run.
            facts: Sentences for the README and the head of the code.
        """
        machine, digest = self.config.machine, self.config.digest
        return Form(
            name, machine.name, machine.axis, digest, version("ballscrew-observer"), self.period_s, constants,
            tuple(slots), tuple(parts), tuple(facts),
        )  # fmt: skip


def observer_form(config: Config) -> Form:
    """Return the reduced observer of a configuration.

    It contains the compensation if the configuration has an expansion coefficient, and the force of a screw
    that is held at both ends.

    Raises:
        ConfigError: If it cannot be exported: the model varies in time, a heat law is not a sum, all sensors
            together have no gain, or two names become equal.
    """
    machine = Exportable(config)
    gains = gain_sets(config, machine.plant, machine.step)
    constants = plant_constants(machine) | input_constants(machine) | _gain_constants(gains)
    parts = list(sequence.ESTIMATE)
    if machine.plant.layout.has_force:
        parts += sequence.TENSION
    if machine.plant.layout.has_error:
        constants |= _compensation_constants(machine)
        parts += sequence.COMPENSATE
        if machine.plant.moving:
            parts += sequence.AT_NUT
    parts.append(sequence.beat)
    return machine.form(
        "observer", constants, observer_slots(machine, constants), parts, _facts(config, gains)
    )


def _facts(config: Config, gains: GainSets) -> list[str]:
    """Return sentences about the gains, and about features of the service that the export lacks."""
    kind = "the steady Kalman gain" if config.estimator.kind == "kalman" else "the placed Luenberger gain"
    facts = [
        f"Gains: {kind}, for all {len(config.sensor)} sensors and without any {gains.most_absent}.",
        f"Quality is 1 (starting) for the first {gains.settled} steps.",
    ]
    if gains.refused:
        facts.append(f"Without {'; '.join(gains.refused)} there is no gain: the observer then predicts only.")
    learns = [key for key in config.learnt if key != "offset_K" or config.tolerance.offset_K > 0]
    if learns:
        facts.append(f"Not exported: what the service learns while it runs ({', '.join(learns)}).")
    if config.estimator.screens and config.integrity.enabled:
        facts.append("Not exported: bounds and the screening of readings; the gate alone refuses readings.")
    return facts


def plant_constants(machine: Exportable) -> dict[str, Any]:
    """Return the constants of the step, the output rows, and the columns of moving nuts, by name.

    Names are those that `algorithm` uses. Heat columns are in K/s per W, decay factors are those of one
    period, and output rows are in °C, and in µm for the error. Output columns of moving nuts' lags are zero
    in `C`, because a nut's table replaces them.

    Args:
        machine: The configuration with plant and step.
    """
    plant, step = machine.plant, machine.step
    n_x, m_e, rows = len(plant.decay_1_s), len(plant.heat_decay_1_s), plant.rows
    lag_of = [plant.modes + nut.index for nut in plant.moving]
    C = rows.C.copy()
    C[:, lag_of] = 0.0
    errors = rows.grid if plant.layout.has_error else 0
    return {
        "PERIOD_S": machine.period_s, "LONG": LONG, "SANE": _SANE, "STATES": n_x, "HEATS": m_e,
        "SOURCES": len(plant.source_names), "KNOWN": len(plant.known_names), "SENSORS": rows.sensors,
        "GRID": rows.grid, "REPORTED": rows.sensors, "ERRORS": errors, "ROWS": len(rows.C),
        "NUTS": len(plant.moving),
        "DECAY": step.decay, "HOLD": step.hold, "RAMP": step.ramp, "HEAT_DECAY": step.heat_decay,
        "COUPLE": step.couple, "HEAT_OF": np.flatnonzero(plant.estimated), "B": plant.B.T, "E": plant.E.T,
        "C": C, "F": rows.F, "LAGS": plant.lags, "UNIFORM": plant.uniform, "LAG_OF": np.array(lag_of, int),
        "GRID_M": plant.layout.position_m, "GRID_1_M": 1.0 / np.diff(plant.layout.position_m),
        **_nut_constants(machine), **_support_constants(machine),
    }  # fmt: skip


def _nut_constants(machine: Exportable) -> dict[str, Any]:
    """Return columns of moving nuts at places along the screw, and last those for the whole stroke."""
    moving, length_m = machine.plant.moving, machine.config.screw.length_m
    if not moving:
        return {}
    fine_m = min(nut.table.nut_m for nut in moving) / _PARTS_OF_NUT
    stroke_m = max(nut.table.stroke_m for nut in moving)
    places = min(1 + math.ceil(length_m / fine_m), TABLE_POINTS)
    points = min(1 + math.floor(stroke_m / fine_m), _MOST_POINTS)
    columns = [_columns(nut, np.linspace(0.0, length_m, places)) for nut in moving]
    lag_rate = np.array([nut.table.lag_decay_1_s for nut in moving])
    return {
        "PLACES": places, "LAST_PLACE": float(places - 1), "PLACES_1_M": (places - 1) / length_m,
        "POINTS": points, "PART": (np.arange(points) + 0.5) / points, "SHARE": 1.0 / points,
        "NUT_OF": np.array([nut.index for nut in moving]),
        "NUT_AT": np.array([machine.config.channels.index(nut.channel) for nut in moving]),
        "NUT_CHANNEL": machine.config.channels.index(moving[0].channel),
        "NUT_B": np.array([B for B, _ in columns]), "NUT_C": np.array([C for _, C in columns]),
        "SETTLE": -np.expm1(-machine.period_s * lag_rate),
    }  # fmt: skip


def _columns(nut: MovingSource, places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return B (P + 1, n_x) and C (P + 1, R): at each place, and last with the nut spread over its stroke."""
    table = nut.table
    B, C = map(np.array, zip(*(columns_at(table, [x]) for x in places_m), strict=True))
    spread = table.turn @ table.mean_B if len(table.turn) else table.mean_B
    return np.vstack([B, spread]), np.vstack([C, table.mean_C])


def input_constants(machine: Exportable) -> dict[str, Any]:
    """Return the constants of the inputs: plausible values, ages, and effects on known inputs and heats.

    Ages are counted in periods. A channel without a limit has ±`UNLIMITED`. An input is stale after two of
    its own sampling intervals, as in the aligner.

    Raises:
        ConfigError: If a heat law is not a sum that a controller can compute.
    """
    config, read = machine.config, machine.drive.read
    limits, sensors = Limits.of(config), [s.channel for s in config.sensor]
    usual_s = [config.sample_s.get(name, machine.period_s) for name in config.channels]
    age = [_STALE_PERIODS * max(machine.period_s, usual) / machine.period_s for usual in usual_s]
    fixed, reference = machine.drive.initial().z, machine.plant.known.reference
    terms = law_terms(config)
    at = np.asarray(read.inputs).copy()
    opens = reference is not None and at[reference] < 0 and math.isnan(fixed[reference])
    if opens and at[read.ambient] < 0:
        fixed[reference], opens = fixed[read.ambient], False
    return {
        "INPUTS": len(config.channels),
        "LOW": np.maximum(limits.low, -UNLIMITED), "HIGH": np.minimum(limits.high, UNLIMITED),
        "LIMIT": np.minimum(np.floor(np.array(age) + 1e-9), LONG - 1).astype(int),
        "NEEDED": np.array([int(name not in sensors) for name in config.channels]),
        "SENSOR_AT": np.array([config.channels.index(name) for name in sensors]),
        "KNOWN_AT": at, "KNOWN_SHIFT": np.asarray(read.shift_K) + np.where(at < 0, np.nan_to_num(fixed), 0.0),
        "REFERENCE": int(reference) if opens and reference is not None else -1,
        "AMBIENT_AT": int(at[read.ambient]),
        "LAW_W": terms.constant, "LAW_SIZE": terms.size, "LAW_VALUE": terms.value, "LAW_ON": terms.on,
        "LAW_APART": terms.apart,
        "SEEN": machine.plant.rows.C[machine.plant.rows.sensor_slice] @ machine.plant.uniform,
    }  # fmt: skip


def _gain_constants(gains: GainSets) -> dict[str, Any]:
    """Return the constants of the gains and of the gate."""
    sets = len(gains.K) // 2
    return {
        "SETS": sets, "NONE": 2 * sets, "MOST_ABSENT": gains.most_absent, "SET_OF": gains.number,
        "GAIN": gains.K, "GATE_K2": gains.gate_K2, "SETTLED": gains.settled, "RELEASE": RELEASE_AFTER_STEPS,
        "SILENT": STALE_AFTER_STEPS,
    }  # fmt: skip


def _compensation_constants(machine: Exportable) -> dict[str, Any]:
    """Return the constants of the table over the travel; see `observer.control.compensation`."""
    plan, grid_m = plan_of(machine.config), grid_of(machine.config)
    place = np.interp(plan.screw_m, grid_m, np.arange(len(grid_m), dtype=float))
    low = np.minimum(place.astype(int), len(grid_m) - 2)
    apart_m = float(plan.screw_m[1] - plan.screw_m[0])
    return {
        "TABLE": len(plan.screw_m), "TABLE_LOW": low, "TABLE_RIGHT": place - low,
        "TABLE_REFERENCE": plan.reference, "DIRECTION": plan.direction, "LIMIT_UM": plan.limit_um,
        "MOST_RISE_UM": plan.gradient_um_m * apart_m, "MOST_STEP_UM": plan.rate_um_s * machine.period_s,
        "TRAVEL_M": float(plan.screw_m[0]), "TABLE_1_M": 1.0 / apart_m,
        "LAST_POINT": float(len(plan.screw_m) - 1), "STILL": int(LATE_PERIODS),
    }  # fmt: skip


def observer_slots(machine: Exportable, c: dict[str, Any]) -> list[Slot]:
    """Return every input, output and array of the observer.

    Args:
        machine: The configuration with its plant.
        c: All constants, whose sizes give the shapes.

    Returns:
        Inputs first, then outputs in the order of the README, then state.
    """
    return [*_inputs(machine), *_outputs(machine), *_remembered(c)]


def _inputs(machine: Exportable) -> list[Slot]:
    channels = machine.config.channels
    labels, units = identifiers(channels), tuple(map(unit_of, channels))
    size = (len(channels),)
    return [
        Slot(
            "reading", "real", "input", "what came, each in the unit that ends its name", size, labels, units
        ),
        Slot("fresh", "bool", "input", "whether it came since the step before", size, labels),
        *_commands(machine),
    ]


def _commands(machine: Exportable) -> list[Slot]:
    if not machine.plant.layout.has_error:
        return []
    return [
        Slot("enable", "bool", "input", "rises to arm the compensation; false lets it go to zero"),
        Slot("heartbeat", "int", "input", "differs from step to step while who delivers the inputs is alive"),
    ]


def _support_constants(machine: Exportable) -> dict[str, float]:
    restraint = machine.plant.rows.restraint
    if restraint is None or not machine.plant.layout.has_force:
        return {}
    return {"STIFFNESS_N_UM": restraint.stiffness_N_um, "LOST_UM": restraint.lost_um}


def force_slots(layout: Layout) -> list[Slot]:
    """Return the force output of a screw that is held at both ends; an empty list for others."""
    text = "axial force in the screw, tension positive"
    return [Slot("force_N", "real", "output", text, units=("N",))] if layout.has_force else []


def _outputs(machine: Exportable) -> list[Slot]:
    """Return the outputs of the observer in their order, each with shape, labels and unit.

    Thermal error and compensation are left out without an expansion coefficient.
    """
    plant, layout, config = machine.plant, machine.plant.layout, machine.config
    places = tuple(f"{1000 * x:.10g}_mm" for x in layout.position_m)
    channels, sensors = identifiers(config.channels), identifiers(layout.sensors)
    sources = identifiers(layout.sources)

    def out(name: str, kind: Kind, text: str, labels: tuple[str, ...] = (), unit: str = "") -> Slot:
        shape = (len(labels),) if labels else ()
        return Slot(name, kind, "output", text, shape, labels, (unit,) if unit else ())

    outputs = [
        out("heat_W", "real", "heat of each estimated source", sources, "W"),
        out("field_degC", "real", "temperature along the screw", places, "degC"),
        out("innovation_K", "real", "measured minus expected, of each sensor", sensors, "K"),
        out("sensor_quality", "int", "0 good, 1 missing, 2 stale, 3 rejected", sensors),
        out("age_s", "real", "time since each input's last plausible value", channels, "s"),
        out("quality", "int", "0 good, 1 starting, 2 degraded, 3 stale, 4 invalid"),
        out("alive", "int", f"counts the steps, from 0 again after {LONG}"),
    ]
    outputs += force_slots(layout)
    if not layout.has_error:
        return outputs
    travel = tuple(f"{1000 * x:.10g}_mm" for x in plan_of(config).machine_m)
    outputs += [
        out("error_um", "real", "thermal error along the screw", places, "um"),
        out("armed", "bool", "whether the compensation follows the estimate"),
        out("compensation_um", "real", "error to take out, along the travel in the machine", travel, "um"),
    ]
    if plant.moving:
        outputs.append(
            out("error_nut_um", "real", "thermal error where the nut is, in the machine", unit="um")
        )
        outputs.append(out("compensation_nut_um", "real", "error to take out where the nut is", unit="um"))
    return outputs


def _remembered(c: dict[str, Any]) -> list[Slot]:
    """Return the state and scratch arrays of a step."""
    n, n_x, s, i, m, p = (c[k] for k in ("STATES", "STATES", "SENSORS", "INPUTS", "SOURCES", "KNOWN"))
    n += c["HEATS"]
    nuts, places = c["NUTS"], c.get("PLACES", 0)
    table = c.get("TABLE", 0)
    rows: list[tuple[str, Kind, tuple[int, ...]]] = [
        ("x", "real", (n,)), ("B", "real", (m, n_x)), ("lag_C", "real", (nuts, c["ROWS"])),
        ("value", "real", (i,)), ("age", "int", (i,)), ("seen", "bool", (i,)), ("came", "bool", (i,)),
        ("late", "bool", (i,)), ("z", "real", (p,)), ("z_before", "real", (p,)),
        ("reference_degC", "real", ()), ("ready", "bool", ()), ("based", "bool", ()),
        ("law_now", "real", (m,)), ("law_W", "real", (m,)), ("begun", "bool", ()),
        ("weight", "real", (places + 1 if nuts else 0,)), ("located", "bool", (nuts,)),
        ("nut_m", "real", (nuts,)), ("usable", "bool", (s,)), ("count", "int", ()), ("started", "bool", ()),
        ("opened", "bool", ()), ("judged", "bool", ()), ("since", "int", ()),
        ("level_degC", "real", (s,)), ("suspect", "int", (s,)),
        ("chosen", "int", ()), ("accepted", "bool", (s,)), ("row", "real", (c["ROWS"],)),
        ("silent", "int", ()), ("beats", "int", ()),
    ]  # fmt: skip
    if table:
        rows += [
            ("heartbeat_before", "int", ()), ("still", "int", ()), ("enabled", "bool", ()),
            ("latched", "bool", ()), ("table_um", "real", (table,)),
            ("wanted_um", "real", (table,)), ("running_um", "real", (table,)),
        ]  # fmt: skip
    role: Role = "state"
    return [Slot(name, kind, role, "", shape) for name, kind, shape in rows]
