"""The result of a discovery, in sentences for people; made from records, never from other sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import floor, log10
from typing import Any

from observer.config.effects.base import FAMILIES
from observer.config.effects.catalogue import effect_class
from observer.discovery.candidates import Candidate
from observer.discovery.discover import Discovery
from observer.discovery.experiment import HOPELESS, SEPARATES
from observer.discovery.verdict import Verdict
from observer.report.panels import duration_text

PHASES = {
    "isothermal": "before any work",
    "heat_up": "heating up",
    "steady": "warm and working",
    "dwell": "short rest",
    "cool_down": "cooling down",
}
REGRESSORS = {
    "speed": "speed",
    "speed^(2/3)*rise": "speed^(2/3) × rise over ambient",
    "rise": "rise over ambient",
    "position": "position of the nut",
    "ambient": "ambient temperature",
    "dT/dt": "rate of change",
    "working": "whether the machine works",
    "running_time": "time spent working",
    "time": "time since the start",
    "event": "a single event",
    "none": "nothing in the logs",
}
SUPERSCRIPT = str.maketrans("23", "²³")
"""Digits of powers in a unit, as people write them."""


def as_sentences(discovery: Discovery, result: dict[str, Any]) -> Iterator[str]:
    """Yield the result of a discovery, line by line: verdict, parameters or the deciding test, residual.

    Args:
        discovery: The search.
        result: The content of its `result.json`.
    """
    yield f"{headline(discovery.verdict, result)}."
    for effect in result["effects"]:
        values = ", ".join(f"{key} = {measured(p)}" for key, p in effect["parameters"].items())
        yield f"  {name_of(effect)}: {values}"
    for suspect in result["suspects"]:
        yield f"{suspect['text']}."
    if result["partial"] is not None:
        yield f"{partial_sentence(result['partial'])}."
    happened = event_of(result)
    if happened is not None:
        log = f"log {happened['log']}"
        yield f"{event_sentence(happened, log)}."
    if result["experiment"] is not None:
        yield f"{experiment_sentence(result['experiment'])}."
    if result["displacements"] is not None:
        yield f"{displacement_sentence(result['displacements'])}."
    yield f"{gap_sentence(result)}."
    if result["worth"] is not None:
        yield f"{worth_sentence(result['worth'])}."
    if discovery.search.blind:
        yield f"{not_identifiable_sentence(discovery.search.blind)}."


_SUPPORTED = {
    True: "; they support the name",
    False: "; they speak against what would explain the temperatures",
}


def displacement_sentence(displacements: dict[str, Any]) -> str:
    """Return the verdict of the displacement sensors, without a full stop.

    Args:
        displacements: The entry of `result.json`.
    """
    names = " or ".join(
        f"{c['key']} = {c['value']:.4g} ({c['ci95'][0]:.4g} … {c['ci95'][1]:.4g}) {unit_text(c['unit'])}"
        f", {c['before']:.4g} before"
        for c in displacements["causes"]
    )
    text = {
        "explained": "What the temperatures make the screw grow explains the displacements",
        "named": f"The displacements show {names}",
        "ambiguous": f"The displacements cannot distinguish {names}",
        "unknown": "Something moves the axis that no temperature shows, and it is none of what was tried",
        "not_identifiable": "There are too few displacements to say anything of them",
    }[displacements["verdict"]]
    return text + _SUPPORTED.get(displacements["supports"], "")


def headline(verdict: Verdict, result: dict[str, Any]) -> str:
    """Return the verdict in one plain sentence, without its full stop.

    Args:
        verdict: The verdict with its reasons.
        result: The content of `result.json`.
    """
    if verdict.kind == "named":
        return f"The model lacks {joined([lack_of(e['kind'], e['target']) for e in result['effects']])}"
    if verdict.kind == "none":
        missing = "no missing effect is visible"
        doubted = f"The logs themselves are in doubt; {missing}"
        return doubted if verdict.suspected else f"The calibrated model explains the logs; {missing}"
    if verdict.kind == "ambiguous":
        answers = [joined([lack_of(c.kind, c.target) for c in causes]) for causes in verdict.sets]
        alternatives, family = joined(answers, last="; or ", between="; "), result["family"]
        lacks = "one of these effects" if family is None else family_text(family)
        return f"The model lacks {lacks}; the logs cannot distinguish its possible causes: {alternatives}"
    if verdict.suspected:
        return "The logs themselves are in doubt, so no effect is reported as missing"
    if verdict.kind == "unknown":
        left = f" that the library does not contain: an error remains {verdict.remains}"
        return f"Something is missing{f', but {verdict.reason}' if verdict.unproved else left}"
    return f"Whether an effect is missing is not identifiable from these logs: {'; '.join(verdict.lacking)}"


def lack_of(kind: str, *targets: str | None) -> str:
    """Return an effect, at one target or at several, as the part that a model without it lacks.

    Args:
        kind: The effect's kind, which the library contains.
        targets: Sensors, sources or ends; None for an effect of the whole machine.
    """
    effect = effect_class(kind)
    ends = ("left", "right") if effect.targets != "sensor" else ()
    return effect.missing_physics.format(
        target=joined([f"the {t} end" if t in ends else str(t) for t in targets])
    )


def family_text(family: dict[str, Any]) -> str:
    """Return a family with its value and its companions, as the missing part of a model.

    Args:
        family: The entry of `result.json`.
    """
    texts = [_family_text(family), *(_family_text(other) for other in family.get("beside", ()))]
    return joined(texts)


def _family_text(family: dict[str, Any]) -> str:
    """A family with its figure; where it has none, its only member."""
    if family["name"] is None:
        kind, _, target = family["members"][0].partition(" at ")
        return lack_of(kind, target or None)
    target = family["target"]
    lacks = FAMILIES[family["name"]].missing_physics.format(target=f"the {target} end")
    return f"{lacks} of {joined([measured(p) for p in family['effective'].values()])} in effect"


def partial_sentence(partial: dict[str, Any]) -> str:
    """Return the share that an effect explains, and the remainder, without a full stop.

    Args:
        partial: The entry of `result.json`.
    """
    if partial["family"] is None:
        values = ", ".join(f"{key} = {measured(p)}" for key, p in partial["parameters"].items())
        cause = f"{lack_of(partial['kind'], partial['target'])} ({name_of(partial)}: {values})"
    else:
        cause = family_text(partial["family"])
    doing = "" if partial["phase"] is None else f", {during(partial['phase'])}"
    remain, excess = (kelvin(partial[f"remains_{key}rms_K"]) for key in ("", "beyond_tolerances_"))
    return (
        f"Of what is missing {cause} explains {100 * partial['share']:.0f} %; {remain} rms remain ({excess} "
        f"beyond tolerances), most on {partial['most_on']}{doing}"
    )


def worth_sentence(worth: dict[str, float]) -> str:
    """Return the change of thermal error by an answer, without a full stop.

    Args:
        worth: The entry of `result.json`: rms and largest error in µm, before and after.
    """
    before, after, most, left = (
        um(worth[f"{key}_um"]) for key in ("before_rms", "after_rms", "before_largest", "after_largest")
    )
    return (
        "As thermal error of a free screw, at the worst place within the strokes, the prediction was off by "
        f"{before} rms (at most {most}) and is now off by {after} ({left})"
    )


WORTH_NOTE = (
    "By the expansion coefficient, the screw held at its left end. Now: of measured less predicted, "
    "interpolated between the sensors, their own offsets included. Before: with what the predicted fields "
    "differ by."
)


def during(phase: str) -> str:
    """Return when something is, by the phase: `while heating up`, `before any work`."""
    words = PHASES.get(phase, phase)
    return words if phase == "isothermal" else f"while {words}"


def name_of(effect: dict[str, Any]) -> str:
    """Return kind and target of an effect, such as `sensor_bias at t3`."""
    return effect["kind"] if effect["target"] is None else f"{effect['kind']} at {effect['target']}"


def gap_sentence(result: dict[str, Any]) -> str:
    """Return how far measured and predicted are apart on the proof, without a full stop.

    Args:
        result: The content of `result.json`.
    """
    gap, excess = result["gap"], result["gap"]["beyond_tolerances"]
    before, after, configured = (kelvin(gap[f"{key}_rms_K"]) for key in ("before", "after", "as_given"))
    first_K, last_K = (kelvin(excess[f"{key}_rms_K"]) for key in ("before", "after"))
    noise = f"noise alone: {kelvin(gap['floor_rms_K'])}"
    if gap["before_rms_K"] == gap["after_rms_K"]:
        return (
            f"On data held back the calibrated model is off by {after} rms, {last_K} beyond tolerances "
            f"(as configured: {configured}; {noise})"
        )
    with_what = {
        "ambiguous": " with the first of them",
        "unknown": " with the best that the library offers",
    }.get(result["verdict"], "")
    return (
        f"On data held back the gap goes from {before} to {after} rms{with_what}, beyond tolerances from "
        f"{first_K} to {last_K} ({noise})"
    )


def not_identifiable_sentence(blind: Sequence[Candidate]) -> str:
    """Return the effects that are not identifiable from these logs, without a full stop.

    Args:
        blind: The candidates whose effect the calibrated parameters could absorb; at least one.
    """
    targets: dict[str, list[str | None]] = {}
    for candidate in blind:
        targets.setdefault(candidate.kind, []).append(candidate.target)
    lacks = joined([lack_of(kind, *at) for kind, at in targets.items()], last=", nor ")
    return f"These logs cannot identify {lacks}: the calibrated parameters could absorb it"


def event_of(result: dict[str, Any]) -> dict[str, Any] | None:
    """Return the entry of `where` for an event that no effect explains; None without one."""
    return next((place for place in result["where"] if place["regressor"] == "event"), None)


def event_sentence(event: dict[str, Any], log: str) -> str:
    """Return where, when, and by how many watts something happened, without a full stop.

    Args:
        event: An entry of `where` in `result.json`.
        log: The name of its log, or its number in words.
    """
    heat, wide = abs(event["heat_W"]), 1.96 * event["heat_sigma_W"]
    watts = f"{heat:.{_digits(wide)}f} ± {wide:.{_digits(wide)}f}"
    sign = "more" if event["heat_W"] > 0 else "less"
    above = "above" if event["mean_K"] > 0 else "below"
    begin, end = (duration_text(event[key]) for key in ("from_s", "to_s"))
    return (
        f"The error is largest near sensor {event['sensor']} in {log}, from {begin} to {end} "
        f"({PHASES.get(event['phase'], event['phase'])}): {watts} W {sign} heat than the model has, "
        f"measured {kelvin(abs(event['mean_K']))} {above} predicted"
    )


def experiment_sentence(experiment: dict[str, Any]) -> str:
    """Return the test that would decide, and how surely, without a full stop.

    Args:
        experiment: The entry of `result.json`.
    """
    sigma = experiment["separation_sigma"]
    if sigma < HOPELESS:
        return "None of the usual test cycles would decide; another sensor or a measured input is needed"
    doubt = "" if sigma >= SEPARATES else ", which may not be enough"
    apart = f"{sigma:.1f}" if sigma < 100 else "more than 100"
    return (
        f"A test of {duration_text(experiment['duration_s'])} would decide: {experiment['description']}; "
        f"it separates the answers by {apart} standard deviations{doubt}"
    )


def joined(parts: Sequence[str], last: str = " and ", between: str = ", ") -> str:
    """Return parts as a list in a sentence, such as `a, b and c`.

    Args:
        parts: The entries; an empty list gives an empty text.
        last: Stands before the last entry.
        between: Stands between the others.
    """
    return last.join([between.join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def measured(parameter: dict[str, Any]) -> str:
    """Return a value with its 95 % interval and unit.

    Args:
        parameter: A table with `value`, `ci95` and `unit`.
    """
    low, high = parameter["ci95"]
    return " ".join(filter(None, [interval(parameter["value"], low, high), unit_text(parameter["unit"])]))


def interval(value: float, low: float, high: float) -> str:
    """Return a value and its 95 % interval, rounded to the digits that the interval leaves.

    Args:
        value: The value.
        low: Lower end of the interval.
        high: Upper end; if it is not above `low`, the value has three digits and no interval.
    """
    if high <= low:
        return f"{value:.3g}"
    digits = _digits((high - low) / 20)  # one more than the half width asks for
    shown = [f"{x:z.{digits}f}".replace("-", "−") for x in (value, low, high)]
    return f"{shown[0]} ({shown[1]} … {shown[2]})"


def _digits(uncertainty: float) -> int:
    """The decimals that show an uncertainty to one digit."""
    return min(max(-floor(log10(uncertainty)), 0), 9) if uncertainty > 0 else 3


def unit_text(unit: str) -> str:
    """Return a unit as people write it, such as `W/m²K`; empty for a pure number."""
    return "" if unit == "1" else unit.translate(SUPERSCRIPT)


def kelvin(value_K: float) -> str:
    """Return a difference of temperatures to two or three digits, with its unit."""
    if abs(value_K) >= 100:
        return f"{value_K:.0f} K"
    return f"{value_K:#.3g} K" if abs(value_K) >= 1 else f"{value_K:#.2g} K"


def um(value_um: float) -> str:
    """Return a thermal error to two or three digits, with its unit."""
    return f"{value_um:.0f} µm" if value_um >= 100 else f"{value_um:.{1 if value_um >= 9.95 else 2}f} µm"
