"""What is wrong with the logs rather than with the model, as far as it shows.

All logs are looked at, the proof as well, for a suspect is no part of a model: it can only take a name back.
It is told where it explains the logs, but for a rest, and no single effect of the library does so as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config import Config
from observer.discovery.candidates import Signature, promises
from observer.discovery.log_faults import Look, Weighed, What, deviance, follows, score, weigh
from observer.discovery.search import BLIND, PER_PARAMETER, Trial
from observer.discovery.verdict import WITHIN_REACH
from observer.effects.base import EffectTable
from observer.effects.terms import AmbientShift
from observer.fit.hypothesis import Fit
from observer.fit.problem import Problem
from observer.physics.constants import RAD_S_PER_RPM

LEAST = 30.0
"""The least fall of the deviance over all logs, less what parameters have to earn, that tells a suspect."""
LEAST_FOLLOWING = 100.0
"""The same of a sensor that follows a heat: beside a source one dimension alone is a little wrong."""
BEYOND = {"ambient": 3.0, "offsets": 12.0}
"""The same beside what the configuration tolerates of the air and of offsets."""
SPARED = 12.0
"""The same where the tolerances explain the logs without it: one of them at three and a half of its sigma."""
BEYOND_PER_LOG = 3.0
"""By how much each log's scale of heats, beside what is tolerated of it, has to bring the deviance down: 1.7
standard deviations. Of more logs no more is asked for each.
"""
SHARE = 0.9
"""The least part of what noise does not explain that has to go with it."""
WITHIN = 0.01
"""A single effect whose fall is lower by less than this part, or by `WITHIN_REACH`, explains as much."""
ALIKE = 2.0
"""Offsets whose mean is so many times their spread are alike."""
SLOWLY = 5
"""Half minutes within which a sensor that follows a heat shows all of it."""
FACTORS = {
    "rpm": {
        "rad/s": 1.0 / RAD_S_PER_RPM, "revolutions a second": 60.0, "degrees a second": 1.0 / 6.0,
        "revolutions an hour": 1.0 / 60.0,
    },
    "W": {"kW": 1000.0, "mW": 0.001},
}  # fmt: skip
"""What an input in another unit is to be multiplied by."""
LIKE = 0.5
"""How near (natural logarithm) to a unit's factor a heat's has to be."""


class Suspect(NamedTuple):
    """Something that is wrong with the logs.

    `channel`: which it is about, several joined by commas; `by`: how much, a number (s late, K too cold, K/W,
    a ratio of heats, K of offset) or the unit; `text`: the same with what to do, in a sentence.
    """

    what: What
    channel: str | None
    by: float | str
    text: str


def suspects(null: Fit, rivals: Sequence[Trial], marks: Sequence[Signature] = ()) -> tuple[Suspect, ...]:
    """Return what is wrong with the logs, as far as it shows; `rivals` are fits of single effects, `marks`
    the signatures of all that could have been fitted.
    """
    if units := tuple(misscaled(null)):  # beside which nothing else can be told
        return units
    for weighed in weigh(null):
        if alike(weighed):
            continue
        if beyond_tolerance(null.problem.config, weighed) and plain(null, weighed, rivals, marks):
            return (told(null.problem, weighed),)
    return ()


def alike(weighed: Weighed) -> bool:
    """Whether offsets are much the same, for then it is the air that is off, or its sensor."""
    spread = float(np.std(weighed.values, ddof=1)) if len(weighed.values) > 1 else np.inf
    return weighed.hypothesis.what == "offsets" and abs(float(np.mean(weighed.values))) > ALIKE * spread


def beyond_tolerance(config: Config, weighed: Weighed) -> bool:
    """Whether a hypothesis earns enough beside what the configuration tolerates of its kind."""
    what = weighed.hypothesis.what
    if config.tolerance == intolerant(config, what).tolerance:
        return score(weighed) >= (LEAST_FOLLOWING if what == "sensor follows the heater" else LEAST)
    if what == "heat differs between logs":
        return weighed.drop >= BEYOND_PER_LOG * weighed.hypothesis.parameters
    return score(weighed) >= BEYOND[what]


def plain(null: Fit, weighed: Weighed, rivals: Sequence[Trial], marks: Sequence[Signature] = ()) -> bool:
    """Whether a hypothesis, its kind not tolerated, explains the logs, and no single effect does as well."""
    noise = null.problem.evidence.expected * len(null.residual)
    taken = deviance(null) <= noise  # by the tolerances, at a price that this would spare them
    if taken and score(weighed) >= SPARED and _alone(null, weighed, rivals, marks):
        return True
    config, strict = intolerant(null.config, weighed.hypothesis.what), null
    if config.tolerance != null.config.tolerance:
        strict = replace(null, problem=null.problem.tolerant(config))
        weighed = Look.at(strict.problem, weighed.config).weighed(weighed.hypothesis, deviance(strict))
    misfit = weighed.left + weighed.drop - noise
    earned = score(weighed) >= LEAST and weighed.drop >= SHARE * misfit
    return earned and _alone(null, weighed, rivals, marks)


def _alone(null: Fit, weighed: Weighed, rivals: Sequence[Trial], marks: Sequence[Signature]) -> bool:
    """Whether no single effect explains the logs as well as a hypothesis about them."""
    as_well = any(_as_well(null, weighed, trial) for trial in rivals if not _the_same(weighed, trial))
    return not as_well and not _promised(null, weighed, marks)


def _the_same(weighed: Weighed, rival: Trial) -> bool:
    """Whether an effect is what is suspected: the air, as it goes on."""
    return weighed.hypothesis.what == "ambient" and about_the_air(rival.fit)


def _promised(null: Fit, weighed: Weighed, marks: Sequence[Signature]) -> bool:
    """Whether an effect, no stronger than it may be, promises to leave less of all logs than a hypothesis
    about them. One that shows on the proof alone is not among those fitted, and suspects look at the proof.
    """
    before = deviance(null)
    for promise in promises(null, marks, everywhere=True):
        candidate = promise.signature.candidate
        effect = candidate.effect(candidate.shapes[promise.signature.shape])
        more = PER_PARAMETER * (len(candidate.fitted) - weighed.hypothesis.parameters)
        same = weighed.hypothesis.what == "ambient" and _is_air(effect, null.config)
        if before - promise.drop + more < weighed.left and promise.kept >= BLIND and not same:
            return True
    return False


def _is_air(effect: EffectTable, config: Config) -> bool:
    """Whether an effect is nothing but another temperature of the air."""
    return all(isinstance(term, AmbientShift) for term in effect.terms(config))


def about_the_air(fit: Fit) -> bool:
    """Whether a fit has an effect that is nothing but another temperature of the air."""
    return any(_is_air(effect, fit.config) for effect in fit.config.effect[len(fit.problem.config.effect) :])


def _as_well(null: Fit, weighed: Weighed, rival: Trial) -> bool:
    """Whether a single effect of the library, within the tolerances, leaves about as little of the logs as a
    hypothesis about them.
    """
    left = deviance(replace(rival.fit, problem=null.problem))
    drop = deviance(null) - left - PER_PARAMETER * (len(rival.candidate.fitted) - 1)
    more = PER_PARAMETER * (len(rival.candidate.fitted) - weighed.hypothesis.parameters)
    return left + more < weighed.left + max(WITHIN_REACH, WITHIN * drop)


def intolerant(config: Config, what: What) -> Config:
    """The configuration without the tolerance that is of the kind of a suspect, if one is."""
    known = config.tolerance
    if what == "ambient":
        return config.model_copy(update={"tolerance": known.model_copy(update={"ambient_K": 0.0})})
    if what == "heat differs between logs":
        return config.model_copy(update={"tolerance": known.model_copy(update={"heat_per_log": 0.0})})
    if what == "offsets":
        sensors = tuple(s.model_copy(update={"offset_K": None}) for s in config.sensor)
        tolerance = known.model_copy(update={"offset_K": 0.0})
        return config.model_copy(update={"sensor": sensors, "tolerance": tolerance})
    return config


def told(problem: Problem, w: Weighed) -> Suspect:
    """A suspect in words."""
    return _TELL[w.hypothesis.what](problem, w)


def _late(_problem: Problem, w: Weighed) -> Suspect:
    late_s = w.hypothesis.late_s
    much, how = f"{abs(late_s):.0f} s", "later" if late_s > 0 else "earlier"
    text = (
        f"In the logs the heat starts {much} {how} than the temperatures tell; set the recorders' clocks "
        f"alike, or move the columns of position, speed and power by {much}"
    )
    return Suspect("heat starts late", None, late_s, text)


def _exchanged(problem: Problem, w: Weighed) -> Suspect:
    config = problem.config
    a, b = (config.sensor[i] for i in w.hypothesis.about)
    text = (
        f"The columns {a.channel} and {b.channel} look exchanged: each fits the place of the other; exchange "
        "the two channels in the configuration, or the wires"
    )
    return Suspect("sensors exchanged", f"{a.channel}, {b.channel}", "exchanged", text)


def _ambient(problem: Problem, w: Weighed) -> Suspect:
    config = problem.config
    channel, runs = config.ambient.channel, len(w.hypothesis.about)
    if len(w.values) == 1:
        most_K, how = float(w.values[0]), f"by {w.values[0]:+.1f} K"
    else:
        hours = [run.run.duration_s / 3600.0 for run in problem.forward.runs]
        begin_K = w.values[:runs]
        end_K = begin_K + w.values[runs:] * hours
        most_K = float(max((*begin_K, *end_K), key=abs))
        each = zip(begin_K.tolist(), end_K.tolist(), strict=True)
        how = "by " + ", ".join(f"{a:+.1f} to {b:+.1f} K in log {i + 1}" for i, (a, b) in enumerate(each))
    said = "the configuration states" if channel is None else f"{channel} says"
    text = (
        f"The air near the screw is not what {said}: it departs from it {how}; measure it beside the screw, "
        "or raise tolerance.ambient_K"
    )
    return Suspect("ambient", channel, _short(most_K), text.replace("-", "−"))


def _differs(problem: Problem, w: Weighed) -> Suspect:
    config = problem.config
    ratios = 1.0 + np.concatenate([[0.0], w.values])
    low, high = int(np.argmin(ratios)), int(np.argmax(ratios))
    ratio = float(ratios[high] / ratios[low])
    sources = [config.source[i] for i in w.hypothesis.about]
    every = len(sources) == sum(s.law not in (None, "heat_of") for s in config.source)
    what = "every source" if every else sources[0].name
    channels = dict.fromkeys(c for s in sources for c in (s.power_channel, s.speed_channel) if c is not None)
    text = (
        f"The same law gives {ratio:.2f} times as much heat of {what} in log {high + 1} as in log {low + 1}; "
        "look for what changed between them (preload, grease, the torque's scale), or search each log alone"
    )
    return Suspect("heat differs between logs", ", ".join(channels) or None, _short(ratio), text)


def _follows(problem: Problem, w: Weighed) -> Suspect:
    at, by = w.hypothesis.about
    sensor, source = problem.config.sensor[at], problem.config.source[by]
    slowly = Look.at(problem, w.config).weighed(follows(at, by, SLOWLY), w.left)
    per_W = float(np.sum(slowly.values))
    text = (
        f"{sensor.channel} shows the heat of {source.name} at once, {per_W:.2g} K for each watt, beside the "
        "screw's own temperature; mount the sensor on the screw, or leave it out of the configuration"
    )
    return Suspect("sensor follows the heater", sensor.channel, _short(per_W), text)


def _offsets(problem: Problem, w: Weighed) -> Suspect:
    config = problem.config
    values = w.values.tolist()
    off = [(s, v) for s, v in zip(config.sensor, values, strict=True)]
    most_K = max(values, key=abs)
    each = ", ".join(f"{s.channel} {v:+.1f} K" for s, v in off).replace("-", "−")
    text = (
        f"The sensors disagree by more than their tolerance: {each}; compare them after a night of "
        "standstill, and correct them or give each sensor its offset_K"
    )
    return Suspect("offsets", ", ".join(s.channel for s, _ in off), _short(most_K), text)


def _short(value: float) -> float:
    return float(f"{value:.3g}")


_TELL: dict[str, Callable[[Problem, Weighed], Suspect]] = {
    "heat starts late": _late,
    "sensors exchanged": _exchanged,
    "ambient": _ambient,
    "heat differs between logs": _differs,
    "sensor follows the heater": _follows,
    "offsets": _offsets,
}


def misscaled(null: Fit) -> Iterator[Suspect]:
    """Yield the inputs whose heats, all of them, fit only after the factor of a unit."""
    given = null.problem.config
    ratio = Look.at(null.problem, given).heats()
    for channel, ours in _inputs(given).items():
        own = [r for key, r in ratio.items() if _input_of(given, key) == channel]
        if not own or min(own) <= 0.0:
            continue
        for unit, factor in FACTORS[ours].items():
            if all(abs(np.log(r / factor)) < LIKE for r in own):
                text = (
                    f"{channel} looks like {unit} where {ours} is expected: the temperatures ask for "
                    f"{factor:.3g} times the heat that its laws give; log it in {ours}"
                )
                yield Suspect("units", channel, unit, text)


def _inputs(config: Config) -> dict[str, str]:
    """The channels from which heats come, and their units."""
    speeds = {s.speed_channel: "rpm" for s in config.source if s.speed_channel is not None}
    return speeds | {s.power_channel: "W" for s in config.source if s.power_channel is not None}


def _input_of(config: Config, key: str) -> str | None:
    """The channel of the source to which a free parameter belongs."""
    source = next(s for s in config.source if s.name == key.partition(".")[2].rpartition(".")[0])
    return source.power_channel or source.speed_channel
