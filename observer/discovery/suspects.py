"""Faults of the logs rather than of the model.

All logs are examined, the proof too, because a suspect is not part of a model and can only withdraw a named
effect. It is reported if it explains nearly all of the error and no single effect of the library explains as
much.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from observer.config.effects.base import EffectTable
from observer.config.effects.terms import AmbientShift, SensorOffset
from observer.config.machine import Config
from observer.discovery.candidates import Signature, promises, score
from observer.discovery.log_faults import FaultFit, FaultKind, Linearised, fit_faults, follows
from observer.discovery.search import BLIND, MATERIAL, FittedCandidate
from observer.discovery.verdict import WITHIN_REACH
from observer.fit.hypothesis import Fit
from observer.fit.problem import Problem
from observer.units import others_of

LEAST = 30.0
"""Least score, over all logs, for a suspect to be reported."""
LEAST_FOLLOWING = 100.0
"""The same for a sensor that follows a heat: the one-dimensional model is inexact beside a source."""
TOLERANCES = {"ambient": "ambient_K", "heat differs between logs": "heat_per_log", "offsets": "offset_K"}
"""The key of `[tolerance]` that corresponds to a kind of suspect."""
LEAST_BEYOND = {"ambient": 3.0, "offsets": 12.0}
"""Least score beyond the configured tolerances of the air and of offsets."""
SPARED = 12.0
"""The same where the tolerances alone explain the logs: one of them at 3.5 σ."""
BEYOND_PER_LOG = 3.0
"""Required drop of the deviance for each log's scale of heats, beyond its tolerance: 1.7 standard deviations,
however many logs there are.
"""
SHARE = 0.9
"""Least part of the misfit beyond noise that it has to explain."""
AS_WELL_SHARE = 0.01
"""A single effect whose drop is lower by less than this part, or by `WITHIN_REACH`, explains as much."""
ALIKE = 2.0
"""Offsets whose mean exceeds this multiple of their spread count as equal."""
SLOWLY = 5
"""Half minutes within which a sensor that follows a heat shows its full effect."""
LIKE = 0.5
"""Largest difference of natural logarithms between a heat's factor and a unit's."""


class Suspect(NamedTuple):
    """A fault of the logs.

    Attributes:
        what: The kind of fault.
        channel: Channels concerned, joined by commas; None if no single channel is.
        by: Size: s late, K too cold, K/W, a ratio of heats, K of offset, positions, or the unit in words.
        text: Sentence with the remedy, without a full stop.
    """

    what: FaultKind
    channel: str | None
    by: float | str
    text: str


Description = tuple[str | None, float | str, str]
"""Channel, how much, and text of a suspect."""


def suspects(
    null: Fit, rivals: Sequence[FittedCandidate], marks: Sequence[Signature] = ()
) -> tuple[Suspect, ...]:
    """Return the faults found in the logs, at most one kind.

    Wrong units are returned alone, because they mask everything else.

    Args:
        null: The fit without effects.
        rivals: Fits of single effects, which must not explain as much.
        marks: Signatures of the library, for effects that only the proof shows.
    """
    if units := tuple(misscaled(null)):  # which mask everything else
        return units
    for fitted in fit_faults(null):
        if alike(fitted):
            continue
        if beyond_tolerance(null.problem.config, fitted) and plain(null, fitted, rivals, marks):
            kind = fitted.fault.kind
            channel, by, text = _DESCRIBE[kind](null.problem, fitted)
            return (Suspect(kind, channel, by if isinstance(by, str) else float(f"{by:.3g}"), text),)
    return ()


def unlikely_offset(null: Fit, ranking: Sequence[FittedCandidate]) -> tuple[Suspect, ...]:
    """Return the sensor whose offset explains most of the logs, if it is unlikely within its tolerance.

    This is for logs for which no effect is named. The tolerance covers an offset of z standard deviations at
    a cost of z², so an offset of a few cannot be named as an effect.

    Args:
        null: The fit without effects.
        ranking: Trials of the first round.

    Returns:
        One suspect, or none. The best trial must be an offset of one sensor with a score of at least
        `SPARED`.
    """
    best = max(ranking, key=lambda t: t.score, default=None)
    if best is None or best.score < SPARED or best.held_out < MATERIAL or not best.significant:
        return ()
    terms = best.candidate.effect(best.candidate.shapes[0]).terms(null.problem.config)
    (value, *further_values), half = best.fit.values.tolist(), float(best.fit.half_width[0])
    match terms:
        case (SensorOffset(name, _, 0.0),) if not further_values:
            (sensor,) = (s for s in null.problem.config.sensor if s.name == name)
            way, z, enough = "much" if value > 0 else "little", np.sqrt(best.drop), np.sqrt(best.least)
            text = (
                f"{sensor.channel} reads {abs(value):.1f} ± {half:.1f} K too {way}, {z:.1f} standard "
                f"deviations of its tolerance where {enough:.1f} name an effect; compare it with the other "
                "sensors after a night at standstill, then correct it or set its offset_K"
            )
            return (Suspect("offsets", sensor.channel, float(f"{value:.3g}"), text),)
    return ()


def alike(fitted: FaultFit) -> bool:
    """Return whether all offsets are about equal; then the air, or its sensor, is off instead."""
    spread = float(np.std(fitted.values, ddof=1)) if len(fitted.values) > 1 else np.inf
    return fitted.fault.kind == "offsets" and abs(float(np.mean(fitted.values))) > ALIKE * spread


def beyond_tolerance(config: Config, fitted: FaultFit) -> bool:
    """Return whether a hypothesis explains enough beyond the configured tolerance of its kind.

    Args:
        config: The machine with its tolerances.
        fitted: The fault, fitted within them.
    """
    kind = fitted.fault.kind
    if config.tolerance == intolerant(config, kind).tolerance:
        return fitted.score >= (LEAST_FOLLOWING if kind == "sensor follows the heater" else LEAST)
    if kind == "heat differs between logs":
        return fitted.drop >= BEYOND_PER_LOG * fitted.parameters
    return fitted.score >= LEAST_BEYOND[kind]


def plain(
    null: Fit, fitted: FaultFit, rivals: Sequence[FittedCandidate], marks: Sequence[Signature] = ()
) -> bool:
    """Return whether a hypothesis, without its kind's tolerance, explains the logs, and no single effect
    does.

    It must explain 90 % of the misfit beyond noise. If tolerances alone explain the logs, a score of `SPARED`
    is enough.

    Args:
        null: The fit without effects.
        fitted: The fault.
        rivals: Fits of single effects.
        marks: Signatures of the library.
    """
    noise = null.problem.evidence.expected * len(null.residual)
    is_explained = (
        null.deviance_of_all <= noise
    )  # by the tolerances, at a cost that this hypothesis would avoid
    if is_explained and fitted.score >= SPARED and _no_effect_explains(null, fitted, rivals, marks):
        return True
    config, strict = intolerant(null.config, fitted.fault.kind), null
    if config.tolerance != null.config.tolerance:
        strict = replace(null, problem=null.problem.with_nuisance(config))
        fitted = Linearised(strict.problem, fitted.config).fitted(fitted.fault, strict.deviance_of_all)
    misfit = fitted.left + fitted.drop - noise
    earned = fitted.score >= LEAST and fitted.drop >= SHARE * misfit
    return earned and _no_effect_explains(null, fitted, rivals, marks)


def _no_effect_explains(
    null: Fit, fitted: FaultFit, rivals: Sequence[FittedCandidate], marks: Sequence[Signature]
) -> bool:
    """Whether no single effect explains the logs as well as a hypothesis about them.

    Fitted effects are judged by their fit within the tolerances. Effects that show only on the proof, which
    suspects use too, are judged by their promise within their bounds. An effect of the air does not compete
    with a fault of the air.
    """
    before, is_air = null.deviance_of_all, fitted.fault.kind == "ambient"
    fault_score = score(before - fitted.left, fitted.parameters)
    for rival in rivals:
        left = replace(rival.fit, problem=null.problem).deviance_of_all
        rival_score = score(before - left, len(rival.candidate.fitted))
        as_well = rival_score > fault_score - max(WITHIN_REACH, AS_WELL_SHARE * rival_score)
        if as_well and not (is_air and about_the_air(rival.fit)):
            return False
    for promise in promises(null, marks, everywhere=True):
        candidate = promise.signature.candidate
        if score(promise.drop, len(candidate.fitted)) > fault_score and promise.unabsorbed >= BLIND:
            effect = candidate.effect(candidate.shapes[promise.signature.shape])
            if not (is_air and _is_air(effect, null.config)):
                return False
    return True


def _is_air(effect: EffectTable, config: Config) -> bool:
    """Whether an effect only changes the temperature of the air."""
    return all(isinstance(term, AmbientShift) for term in effect.terms(config))


def about_the_air(fit: Fit) -> bool:
    """Return whether a fit has added effects, and all of them only change the temperature of the air."""
    effects = fit.config.effect[len(fit.problem.config.effect) :]
    return bool(effects) and all(_is_air(effect, fit.config) for effect in effects)


def intolerant(config: Config, kind: FaultKind) -> Config:
    """Return the configuration without the tolerance that corresponds to a kind of suspect.

    Args:
        config: The machine.
        kind: The kind of fault; for one without a tolerance the configuration is returned unchanged.
    """
    if kind not in TOLERANCES:
        return config
    changes: dict[str, Any] = {"tolerance": config.tolerance.model_copy(update={TOLERANCES[kind]: 0.0})}
    if kind == "offsets":
        changes["sensor"] = tuple(s.model_copy(update={"offset_K": None}) for s in config.sensor)
    return config.model_copy(update=changes)


def _late(_problem: Problem, fitted: FaultFit) -> Description:
    late_s = fitted.fault.late_s
    delay, direction = f"{abs(late_s):.0f} s", "later" if late_s > 0 else "earlier"
    return None, late_s, (
        f"In the logs the heat starts {delay} {direction} than the temperatures indicate; synchronise the "
        f"recorders' clocks, or shift the columns of position, speed and power by {delay}"
    )  # fmt: skip


def _exchanged(problem: Problem, fitted: FaultFit) -> Description:
    a, b = (problem.config.sensor[i].channel for i in fitted.fault.indices)
    return f"{a}, {b}", "exchanged", (
        f"The columns {a} and {b} look exchanged: each fits the other's position; swap the two channels in "
        "the configuration, or the wires"
    )  # fmt: skip


def _ambient(problem: Problem, fitted: FaultFit) -> Description:
    channel, runs = problem.config.ambient.channel, len(fitted.fault.indices)
    if len(fitted.values) == 1:
        most_K, text = float(fitted.values[0]), f"{fitted.values[0]:+.1f} K"
    else:
        hours = [run.run.duration_s / 3600.0 for run in problem.forward.runs]
        ends_K = np.column_stack([fitted.values[:runs], fitted.values[:runs] + fitted.values[runs:] * hours])
        most_K = max(ends_K.T.ravel().tolist(), key=abs)
        text = ", ".join(f"{a:+.1f} to {b:+.1f} K in log {i + 1}" for i, (a, b) in enumerate(ends_K.tolist()))
    reference = "the configuration states" if channel is None else f"{channel} says"
    return channel, most_K, (
        f"The air near the screw differs from what {reference} by {text}; measure it beside the screw, "
        "or raise tolerance.ambient_K"
    ).replace("-", "−")  # fmt: skip


def _differs(problem: Problem, fitted: FaultFit) -> Description:
    config = problem.config
    ratios = 1.0 + np.concatenate([[0.0], fitted.values])
    low, high = int(np.argmin(ratios)), int(np.argmax(ratios))
    sources = [config.source[i] for i in fitted.fault.indices]
    all_sources = len(sources) == sum(s.law not in (None, "heat_of") for s in config.source)
    heat = "every source" if all_sources else sources[0].name
    channels = dict.fromkeys(c for s in sources for c in (s.power_channel, s.speed_channel) if c is not None)
    ratio = float(ratios[high] / ratios[low])
    return ", ".join(channels) or None, ratio, (
        f"The same law gives {ratio:.2f} times as much heat of {heat} in log {high + 1} as in log {low + 1}; "
        "look for what changed between them (preload, grease, the torque's scale), or search each log alone"
    )  # fmt: skip


def _follows(problem: Problem, fitted: FaultFit) -> Description:
    at, by = fitted.fault.indices
    channel = problem.config.sensor[at].channel
    slowly = Linearised(problem, fitted.config).fitted(follows(at, by, SLOWLY), fitted.left)
    per_W = float(np.sum(slowly.values))
    return channel, per_W, (
        f"{channel} responds to the heat of {problem.config.source[by].name} at once, {per_W:.2g} K per watt "
        "on top of the screw's temperature; mount the sensor on the screw, or leave it out of the "
        "configuration"
    )  # fmt: skip


def _offsets(problem: Problem, fitted: FaultFit) -> Description:
    channels, values_K = [s.channel for s in problem.config.sensor], fitted.values.tolist()
    listing = ", ".join(f"{c} {v:+.1f} K" for c, v in zip(channels, values_K, strict=True)).replace("-", "−")
    return ", ".join(channels), max(values_K, key=abs), (
        f"The sensors disagree by more than their tolerance: {listing}; compare them after a night at "
        "standstill, then correct them or set each sensor's offset_K"
    )  # fmt: skip


_DESCRIBE: dict[str, Callable[[Problem, FaultFit], Description]] = {
    "heat starts late": _late,
    "sensors exchanged": _exchanged,
    "ambient": _ambient,
    "heat differs between logs": _differs,
    "sensor follows the heater": _follows,
    "offsets": _offsets,
}


def misscaled(null: Fit) -> Iterator[Suspect]:
    """Yield the channels whose heats all fit only with the factor of another unit.

    A factor counts if its natural logarithm is within 0.5 of the unit's.

    Args:
        null: The fit without effects. The factors are taken at the configured values, before calibration.
    """
    config = null.problem.config
    factors = Linearised(null.problem, config).heats()
    units, ratios = dict[str, str](), dict[str, list[float]]()
    for source in config.source:
        units_by_channel = {source.speed_channel: "rpm", source.power_channel: "W"}
        units |= {channel: unit for channel, unit in units_by_channel.items() if channel is not None}
        factors_of = [
            r for key, r in factors.items() if key.split(".", 1)[1].rpartition(".")[0] == source.name
        ]
        ratios.setdefault(source.power_channel or source.speed_channel or "", []).extend(factors_of)
    for channel, channel_unit in sorted(units.items(), key=lambda item: item[1], reverse=True):
        own_ratios = ratios.get(channel, [])
        for unit in others_of(channel_unit) if own_ratios and min(own_ratios) > 0.0 else ():
            if all(abs(np.log(r / unit.size)) < LIKE for r in own_ratios):
                text = (
                    f"{channel} looks like {unit.in_words} where {channel_unit} is expected: the "
                    f"temperatures require {unit.size:.3g} times the heat that its laws give; "
                    f"log it in {channel_unit}"
                )
                yield Suspect("units", channel, unit.in_words, text)
