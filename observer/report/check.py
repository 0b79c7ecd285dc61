"""The properties of a configuration, as plain data: `observer check`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from observer.align.plausibility import Limits
from observer.config.effects.terms import Radiation, RisingFilm, SpeedLoss, StretchFilm
from observer.config.sections import Source
from observer.errors import ConfigError
from observer.estimators.design.report import DesignReport, design_report
from observer.estimators.selftest import smallest_jump_m
from observer.installation import Installation
from observer.installation.problems import key_of
from observer.installation.typical_ranges import doubt
from observer.kernels.path import SAMPLES_PER_TRAVERSE
from observer.model.build import build_plant, transient_error_K_W
from observer.model.cycle import SPEED_RPM
from observer.model.generator import settled_rows
from observer.model.network import attached
from observer.model.plant import Plant
from observer.model.realise import realise
from observer.model.rod.modes import footprints, solve_modes, tail_left
from observer.model.rod.screw import biot_number, rod_of
from observer.model.rod.supports import force_N
from observer.physics.film import BIOT_LIMIT
from observer.report.sensitivity import detectable, tolerances

TRANSIENT_S = (0.5, 10.0)
MOST_DESIGNED = 200
"""The cost of a design grows with the cube of the modes: seconds here, minutes at twice as many."""
LARGEST_HIDDEN_m = 0.03
"""A reference of the nut that is lost by more than this should be found."""
NEAR = 1e-3
"""Positions closer than this fraction of the screw's length count as one."""
_DEVIATION_OF_STEPS = 1.0 / math.sqrt(12.0)  # what rounding to whole steps of 1 adds


def findings(config: Installation) -> dict[str, Any]:
    """Return the key facts of a configuration: the document of `observer check --json`.

    Args:
        config: The configuration; no device is read.

    Returns:
        Plain data: modes and what they leave out, Biot number, poles in 1/s, noise gain in W/K by source,
            observability by mode, supports, nodes, tolerances, smallest noticed faults, and warnings. A value
            that is infinite is None.

    Raises:
        ConfigError: More than 200 modes are asked for.
        UserError: No gain exists for this configuration.
    """
    if (config.model.modes or 0) > MOST_DESIGNED:
        raise ConfigError(
            f"model.modes = {config.model.modes}: an estimator is designed for {MOST_DESIGNED} modes at "
            "most; give fewer, or leave modes out"
        )
    plant = build_plant(config)
    design = design_report(plant, config.estimator, on_screw=config.screw_is_seen)
    reached = sorted(design.poles_reached_1_s.tolist(), key=lambda p: (-p.real, p.imag))
    errors = transient_error_K_W(config, plant, TRANSIENT_S)
    biot = _biot(config)
    warnings = [*doubts(config), *design.warnings, *_model_warnings(config, design, biot)]
    warnings += slow_polls(config)
    return {
        "verdict": _verdict(design, warnings),
        "modes": plant.modes,
        "mode_numbers": list(plant.mode_index),
        "criterion": "given" if config.model.modes is not None else config.model.criterion,
        "steady_part_left_out": _left_out(config, plant),
        "dropped_modes_settle_s": 1.0 / plant.dropped_rate_1_s,
        "transient_error_K_W": dict(zip((f"{t:g} s" for t in TRANSIENT_S), errors.tolist(), strict=True)),
        "biot": biot,
        "estimator": design.kind,
        "bandwidth_1_s": design.bandwidth_1_s,
        "eigenvalues_1_s": design.eigenvalues_1_s.tolist(),
        "poles_requested_1_s": design.poles_requested_1_s.tolist(),
        "poles_reached_1_s": [p.real for p in reached],
        "poles_reached_imaginary_1_s": [p.imag for p in reached],
        "noise_gain_W_K": {name: _finite(gain) for name, gain in design.noise_gain_W_K.items()},
        "weakest_mode": design.weakest_mode,
        "weakest_mode_sensor": design.weakest_mode_sensor,
        "weakest_mode_share": design.weakest_mode_share,
        "observability_per_mode": dict(zip(map(str, plant.mode_index), _seen(plant), strict=True)),
        "path_told_up_to_rpm": {s.name: _path_limit_rpm(config, s) for s in config.source if s.lead_m},
        "heartbeat_s": config.heartbeats_s,
        "supports": _supports(config, plant),
        "nodes": _nodes(config),
        **tolerances(config),
        **detectable(config),
        "predicted_without": []
        if config.screw_is_seen  # a warning says it there
        else [lost[0] for lost in design.undetermined if len(lost) == 1],
        "warnings": warnings,
    }


def _verdict(design: DesignReport, warnings: list[str]) -> dict[str, Any]:
    """Whether the configuration can be used, and the opening sentence of a check."""
    if not design.placed:
        return {"usable": False, "text": f"not usable: {design.warnings[0]}"}
    if not warnings:
        return {"usable": True, "text": "usable; no warnings"}
    first = f"1 warning: {warnings[0]}" if len(warnings) == 1 else f"{len(warnings)} warnings"
    return {"usable": True, "text": f"usable; {first}"}


def _left_out(config: Installation, plant: Plant) -> float:
    """The largest fraction of a source's steady field that the modes alone would leave out."""
    machine = realise(config).config
    numbers = plant.mode_index[: plant.modes - plant.bent]
    modes = solve_modes(rod_of(machine), max(numbers))
    retained = modes.take([i - 1 for i in numbers])
    stretches = footprints(machine.source, machine.screw)
    return max(tail_left(retained, len(retained), stretch) for stretch in stretches)


def _seen(plant: Plant) -> list[float]:
    """How much of each mode the best sensor sees, against the mode's largest value on the grid."""
    modal = abs(settled_rows(plant)[:, : plant.modes])
    highest = modal[plant.rows.field_slice].max(axis=0)
    share = modal[plant.rows.sensor_slice].max(axis=0) / highest
    return [min(1.0, float(x)) for x in share]


def slow_polls(config: Installation) -> Iterator[str]:
    """Yield a warning for each nut's position that is polled too slowly to show that its reference was
    lost.

    The limit is a loss of 30 mm at the highest plausible speed.
    """
    limits = Limits.of(config)
    for source in config.source:
        period_s = config.sample_s.get(source.position_channel or "")
        if source.lead_m is None or source.speed_channel is None or period_s is None:
            continue
        fastest_m_s = source.lead_m / 60.0 * float(limits.high[config.channels.index(source.speed_channel)])
        hidden_m = min(smallest_jump_m(period_s), smallest_jump_m(0.0) + fastest_m_s * period_s)
        if hidden_m > LARGEST_HIDDEN_m:
            yield (
                f"{source.position_channel} is polled too slowly (each {period_s:g} s, at up to "
                f"{60.0 * fastest_m_s:.0f} m/min): a reference lost by less than {1000.0 * hidden_m:.0f} mm "
                "is not noticed; set period_s of its driver to 0.02"
            )


def _path_limit_rpm(config: Installation, source: Source) -> float:
    """The speed up to which a nut's position is sampled often enough to follow its path."""
    low_m, high_m = source.stroke_m or (0.0, config.screw.length_m)
    sample_s = config.estimator.period_s
    sample_s = config.sample_s.get(source.position_channel or "", sample_s)
    return 60.0 * (high_m - low_m) / ((source.lead_m or 1.0) * SAMPLES_PER_TRAVERSE * sample_s)


def _biot(config: Installation) -> dict[str, float]:
    """The largest film along the screw, turning at `SPEED_RPM` where that adds to it, and its Biot number."""
    machine = realise(config)
    film_W_m2K = machine.config.surface.convection_W_m2K
    film_W_m2K += max((t.extra_W_m2K for t in machine.terms if isinstance(t, StretchFilm)), default=0.0)
    speed_rpm = np.array([SPEED_RPM])
    film_W_m2K += sum(float(t.film_W_m2K(speed_rpm)[0]) for t in machine.terms if isinstance(t, SpeedLoss))
    return {"film_W_m2K": film_W_m2K, "number": biot_number(config.screw, film_W_m2K)}


def _model_warnings(config: Installation, design: DesignReport, biot: Mapping[str, float]) -> list[str]:
    machine = realise(config)
    realised, rod = machine.config, rod_of(machine.config)
    warnings = []
    if biot["number"] > BIOT_LIMIT:
        warnings.append(
            f"the Biot number is {biot['number']:.2g}, above {BIOT_LIMIT:g}: under a film of "
            f"{biot['film_W_m2K']:.3g} W/m²K the temperature is not uniform across the screw, as the "
            "model assumes; "
            "check surface.convection_W_m2K, or expect the core to differ from what the sensors read"
        )
    films = (SpeedLoss, StretchFilm, Radiation, RisingFilm)
    if rod.floating and not any(isinstance(t, films) for t in machine.terms):
        warnings.append(
            "no heat can leave the screw (insulated ends, no film): its mean temperature can only rise; set "
            "surface.convection_W_m2K or an end"
        )
    assembly, period_s = attached(realised, ()), realised.estimator.period_s
    warnings += [
        f"node {assembly.names[node]} and the screw equalise within "
        f"{assembly.network.capacity_J_K[node] / G:.2g} s, "
        f"faster than the period of {period_s:g} s: the step is not exact under a nut that moves; join it "
        "with a neighbour"
        for node, source, G in assembly.ties
        if realised.source[source].position_channel and assembly.network.capacity_J_K[node] < G * period_s
    ]
    for source in realised.source:
        if source.shape == "nut" and source.position_channel is None:
            warnings.append(
                f"source {source.name} has no position_channel: its heat is spread evenly over its stroke; "
                "name the channel of the nut's position"
            )
        at_end = {0.0: rod.left, realised.screw.length_m: rod.right}
        if source.shape == "point" and source.position_m in at_end and at_end[source.position_m].prescribed:
            warnings.append(
                f"source {source.name} stands at an end with a prescribed temperature, where heat changes "
                "nothing; move it, or make that end convective"
            )
    if design.kind == "kalman" and realised.screw.expansion_1_K is None:
        warnings.append(
            "no expansion coefficient: the thermal error is not reported; set screw.expansion_1_K"
        )
    return warnings


def _supports(config: Installation, plant: Plant) -> dict[str, Any] | None:
    """The effect of the supports on a screw that is uniformly 10 K warm; None where none are configured."""
    restraint, screw = plant.rows.restraint, config.screw
    if restraint is None or config.supports is None or screw.expansion_1_K is None:
        return None
    growth_um = 1e6 * screw.expansion_1_K * 10.0 * screw.length_m
    return {
        "mounting": config.supports.mounting,
        "stiffness_N_um": restraint.stiffness_N_um,
        "pretension_lost_at_rise_K": 10.0 * restraint.lost_um / growth_um,
        "gap_closed_at_rise_K": 10.0 * (restraint.lost_um + restraint.gap_um) / growth_um,
        "force_at_10_K_N": float(force_N(restraint, np.array(growth_um))) + 0.0,  # no minus before a zero
    }


def _nodes(config: Installation) -> dict[str, dict[str, float]]:
    """Each node's time constant, and how much 1 W into it warms it at rest, with the screw at ambient
    temperature where it touches that.
    """
    assembly = attached(realise(config).config, ()).with_screw_at_ambient
    through = np.diag(assembly.conductance_W_K)
    rise_K_W = np.diag(np.linalg.pinv(assembly.conductance_W_K))
    return {
        node.name: {"time_constant_s": node.capacity_J_K / float(G), "rise_K_W": float(rise)}
        for node, G, rise in zip(config.node, through, rise_K_W, strict=True)
    }


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def doubts(config: Installation) -> list[str]:
    """Return settings that are valid but unlikely to be intended, a sentence each with its remedy.

    These are values out of the usual range, sensors or sources at one place, strokes shorter than the nut,
    registers read twice, noise finer than a device's steps, and a page without encryption.
    """
    return [
        *_unusual(config.model_dump(exclude_unset=True, by_alias=True)),
        *_same_places(config),
        *_short_strokes(config),
        *_shared_registers(config),
        *_finer_than_the_device(config),
        *_in_the_clear(config),
    ]


def _in_the_clear(config: Installation) -> Iterator[str]:
    if config.page is not None and (doubt := config.page.doubt):
        yield doubt


def _unusual(table: Mapping[str, Any]) -> Iterator[str]:
    for path, value in _numbers(table, ()):
        if reason := doubt(path, value):
            yield f"{key_of(path, table)} = {reason}"


def _numbers(at: Any, path: tuple[int | str, ...]) -> Iterator[tuple[tuple[int | str, ...], float]]:
    """Every number with its path."""
    if isinstance(at, Mapping):
        inner: Iterator[tuple[int | str, Any]] = iter(at.items())
    elif isinstance(at, list | tuple):
        inner = iter(enumerate(at))
    else:
        if isinstance(at, int | float) and not isinstance(at, bool):
            yield path, at
        return
    for key, value in inner:
        yield from _numbers(value, (*path, key))


def _same_places(config: Installation) -> Iterator[str]:
    near_m = NEAR * config.screw.length_m
    thermal = [s for s in config.sensor if s.kind == "temperature"]
    sensors = [(s.name, s.position_m) for s in thermal if s.position_m is not None]
    points = [(s.name, s.position_m) for s in config.source if s.estimate and s.position_m is not None]
    for kind, places, harm in (
        ("sensors", sensors, "the second adds no information; correct one position_m, or keep it as a spare"),
        ("sources", points, "their heats cannot be distinguished; correct one position_m, or join them"),
    ):
        for (one, at_m), (other, other_m) in itertools.combinations(places, 2):
            if abs(at_m - other_m) < near_m:
                yield f"{kind} {one} and {other} are both at {at_m:g} m: {harm}"


def _short_strokes(config: Installation) -> Iterator[str]:
    for source in config.source:
        low, high = source.stroke_m or (0.0, math.inf)
        if source.length_m is not None and high - low < source.length_m:
            yield (
                f"source {source.name}: the stroke of {high - low:g} m is shorter than the nut, "
                f"{source.length_m:g} m; check stroke_m and length_m"
            )


def _shared_registers(config: Installation) -> Iterator[str]:
    """Values that overlap, within a device and between drivers of the same device."""
    entries = [
        (name, channel, addresses)
        for name, driver in config.drivers.items()
        for channel, addresses in driver.occupied().items()
    ]
    for (driver, one, a), (other_driver, other, b) in itertools.combinations(entries, 2):
        if shared := a & b:
            second = other if driver == other_driver else f"{other} of drivers.{other_driver}"
            register = min(address[-1] for address in shared)  # type: ignore[type-var]
            yield (
                f"drivers.{driver}: {one} and {second} both read register {register}; check the "
                "register and the type of both"
            )


def _finer_than_the_device(config: Installation) -> Iterator[str]:
    steps = {channel: step for driver in config.drivers.values() for channel, step in driver.steps().items()}
    for sensor in config.sensor:
        step_K = steps.get(sensor.channel, 0.0)
        if sensor.kind == "temperature" and sensor.noise_K < _DEVIATION_OF_STEPS * step_K:
            yield (
                f"sensor {sensor.name}: noise_K = {sensor.noise_K:g} is finer than its device, whose steps "
                f"of {step_K:g} K alone make {_DEVIATION_OF_STEPS * step_K:.2g} K; raise it to that at least"
            )
