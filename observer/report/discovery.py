"""`report.html`: the result of a discovery, on one page that takes two minutes to read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.config.estimator import Tolerance
from observer.config.sensors import Sensor
from observer.discovery.candidates import PER_PARAMETER
from observer.discovery.discover import Discovery
from observer.discovery.proof import rms
from observer.discovery.result import effects_of
from observer.discovery.search import ACCEPT, MATERIAL, FittedCandidate
from observer.fit.evidence import UNUSED
from observer.fit.tolerance import UNEVEN
from observer.frames import FloatArray
from observer.report import panels_discovery as panels
from observer.report import wording
from observer.report.frame import arrow, excess_text, header, in_lines, made_of, next_step, values
from observer.report.page import (
    Html,
    code,
    document,
    figure,
    paragraph,
    safe,
    section,
    share,
    table,
)
from observer.report.panels import duration_text

PLACES = 5
"""How many of the largest errors are reported."""
PANELS = 6
"""How many sensors share a drawing, so that paper holds it."""
LEAST_SIGMA = 5.0
"""The scale of errors spans at least this many times the noise, so that noise does not look like an error."""


def tolerated(prior: Tolerance) -> str:
    """Return a paragraph with the errors that are tolerated, as the configuration states them."""
    return (
        "No model reaches the noise alone: conductivity is known to "
        f"{100 * prior.conductivity:g} %, heat capacity to {100 * prior.heat_capacity:g} %, each sensor's "
        f"offset to {prior.offset_K:g} K, its position to {1000 * prior.position_m:g} mm and its lag to "
        f"{prior.lag_s:g} s, its part of the rise to {100 * prior.gain:g} %, the air to {prior.ambient_K:g} "
        f"K, heats from log to log to {100 * prior.heat_per_log:g} %, and how even the film is to "
        f"{100 * UNEVEN:.0f} %. A deviation within these tolerances is not an effect and is not written back."
    )


@dataclass(frozen=True, slots=True)
class Shown:
    """A comparison of two configurations.

    Without any effect added, before is as configured and after is calibrated.

    Attributes:
        added: Names of the effects added; empty for none.
        before: Description of the first configuration.
        after: Description of the second one.
        before_K: Errors of its prediction over all means, (n,).
        after_K: The same of the second one, (n,).
    """

    added: tuple[str, ...]
    before: str
    after: str
    before_K: FloatArray
    after_K: FloatArray


def write_discovery_report(
    path: Path, discovery: Discovery, result: dict[str, Any], logs: Sequence[str]
) -> None:
    """Write the page about a discovery.

    Args:
        path: The HTML file; it contains its drawings and loads nothing.
        discovery: The search with its problem and evidence.
        result: The content of its `result.json`.
        logs: The names of the logs.
    """
    shown = _shown(discovery)
    machine = discovery.problem.config.machine
    parts = [
        header(discovery, result, logs),
        next_step(result),
        _suspects(result),
        _doubt(discovery, result),
        _maps(discovery, result, shown, logs),
        _proof(discovery, result, shown, logs),
        _displacements(result),
        _candidates(discovery, result),
        _parameters(discovery, result),
        _limits(discovery, logs),
        made_of(result),
    ]
    page = document(
        f"{wording.headline(discovery.verdict, result)} – {machine.name}, axis {machine.axis}", parts
    )
    path.write_text(page, encoding="utf-8")


def _shown(discovery: Discovery) -> Shown:
    problem, fit, null = discovery.problem, discovery.verdict.fit, discovery.search.null
    names = tuple(wording.name_of(effect) for effect in effects_of(fit))
    before, after = "calibrated, no effect added", f"calibrated, with {wording.joined(names)}"
    reference = null.config
    if not names:
        before, after, reference = "as configured", "calibrated", problem.config
    return Shown(names, before, after, problem.error_K(reference), problem.error_K(fit.config))


def _suspects(result: dict[str, Any]) -> Html:
    """The section on faults in the logs."""
    rows = [
        [s["what"], code(s["channel"]) if s["channel"] else "–", f"{s['text']}."] for s in result["suspects"]
    ]
    note = "Faults of the logs themselves; correct them and search again:"
    heads = ["Suspect", "channel", "what is wrong, and what to do"]
    return (
        section("Suspects", paragraph(note, "note"), table(heads, rows, stacked=True)) if rows else Html("")
    )


def _doubt(discovery: Discovery, result: dict[str, Any]) -> Html:
    """The answers that these logs cannot distinguish, and the test that would decide."""
    problem, fits = discovery.problem, discovery.verdict.fits
    proof = problem.evidence.proof
    rows = []
    for fit in fits if result["verdict"] == "ambiguous" else ():
        error_K = problem.error_K(fit.config)[proof]
        effects = effects_of(fit)
        lacks = wording.joined([wording.lack_of(e["kind"], e["target"]) for e in effects])
        names = Html(", ".join(code(wording.name_of(e)) for e in effects))
        rows.append([lacks, names, in_lines([values(e) for e in effects]), wording.kelvin(rms(error_K))])
    test = result["experiment"]
    return section(
        "The test that would decide" if test is not None else "Answers that explain the logs equally well",
        table(["The model may lack", "effect", "parameters (95 %)", "gap left"], rows, (3,), stacked=True),
        *_test(test),
    )


def _test(test: dict[str, Any] | None) -> Iterator[Html]:
    """The test that would decide, phase by phase, and how well the other cycles would do."""
    if test is None:
        return
    yield paragraph(f"{wording.experiment_sentence(test)}.")
    if test["program"] is not None:
        rows = [
            [
                duration_text(p["duration_s"]),
                f"{p['speed_rpm']:.0f} rpm",
                f"{p['low_m']:.3g} to {p['high_m']:.3g} m" if p["speed_rpm"] else "stands",
            ]
            for p in test["phases"]
        ]
        yield table(["for", "speed", "between"], rows)
        yield paragraph(f"{test['program']} holds it as a program, a row a second.", "note")


def _maps(discovery: Discovery, result: dict[str, Any], shown: Shown, logs: Sequence[str]) -> Html:
    config, evidence = discovery.problem.config, discovery.problem.evidence
    sensors = [s.name for s in config.sensor]
    tracks = panels.tracks_of(evidence, logs, {"before": shown.before_K, "after": shown.after_K})
    event, box = discovery.event, None
    if event is not None:
        box = panels.Box(event.run, sensors.index(event.sensor), event.from_s, event.to_s)
    least_K = LEAST_SIGMA * float(np.median([s.noise for s in config.sensor]))
    headings = {"before": f"Before: {shown.before}", "after": f"After: {shown.after}"}
    drawn, narrow = (
        panels.residual_maps(tracks, sensors, headings, least_K, box, width)
        for width in (panels.WIDTH, panels.NARROW)
    )
    framed = " The frame marks what no effect explains." if box is not None else ""
    caption = (
        "Each row is a sensor, each column half a minute; both maps have one scale. Vermilion: measured is "
        f"warmer than predicted; blue: colder. The strip shows what was fitted and what is proof.{framed}"
    )
    places = [p for p in result["where"] if p["regressor"] != "event"][:PLACES]
    rows = [
        [
            p["sensor"],
            wording.PHASES.get(p["phase"], p["phase"]),
            _signed(p["mean_K"]),
            wording.kelvin(p["rms_K"]),
            f"{wording.REGRESSORS.get(p['regressor'], p['regressor'])}: "
            + wording.interval(p["correlation"], *p["correlation_ci95"]),
        ]
        for p in places
    ]
    heads = ["Sensor", "while", "mean error", "rms", "correlates with (95 %)"]
    note = "Where the calibrated model without any added effect is most wrong, on the data used for fitting:"
    return section(
        "Where and when prediction and measurement disagree",
        figure(drawn, caption, narrow),
        paragraph(note, "note") if rows else Html(""),
        table(heads, rows, (2, 3), stacked=True),
    )


def _proof(discovery: Discovery, result: dict[str, Any], shown: Shown, logs: Sequence[str]) -> Html:
    config, evidence = discovery.problem.config, discovery.problem.evidence
    proof = evidence.proof
    run = int(evidence.run[proof][0])
    measured_degC = evidence.measured_degC
    rows = {
        "measured": measured_degC,
        "before": measured_degC - shown.before_K,
        "after": measured_degC - shown.after_K,
    }
    track = panels.tracks_of(evidence, logs, rows)[run]
    lines = {"measured": "measured", "before": shown.before, "after": shown.after}
    titles, cells = [], []
    for s, sensor in enumerate(config.sensor):
        of_sensor = proof & (evidence.sensor == s)
        name = panels.shortened(sensor.name, 24)
        if not of_sensor.any():
            titles.append(f"{name}: no data")
            continue
        before_K, after_K = rms(shown.before_K[of_sensor]), rms(shown.after_K[of_sensor])
        gap = result["gap"]["per_sensor"][sensor.name]
        titles.append(f"{name}, °C: {arrow(before_K, after_K)} rms")
        kelvins = map(wording.kelvin, (before_K, after_K))
        cells.append(
            [sensor.name, site(sensor), *kelvins, excess_text(gap), wording.kelvin(gap["floor_rms_K"])]
        )
    drawn = []
    for i in range(0, len(titles), PANELS):
        part = titles[i : i + PANELS]
        narrow = panels.comparisons(track, lines, part, i, panels.NARROW)
        drawn.append(figure(panels.comparisons(track, lines, part, i), _caption(i, logs[run]), narrow))
    heads = [
        "Sensor",
        "at",
        f"gap, {shown.before}",
        f"gap, {shown.after}",
        "beyond tolerances",
        "noise alone",
    ]
    return section(
        "Measured against predicted, on data that took no part in fitting or choosing",
        *drawn,
        table(heads, cells, (1, 2, 3, 4, 5), stacked=True),
        paragraph(tolerated(discovery.problem.config.tolerance), "note"),
    )


def _displacements(result: dict[str, Any]) -> Html:
    """The verdict of the displacement sensors, and the prediction error of each."""
    displacements = result["displacements"]
    if displacements is None:
        return Html("")
    keys = ("before_rms_um", "after_rms_um", "floor_rms_um")
    rows = [
        [name, *(wording.um(error[key]) for key in keys)]
        for name, error in displacements["per_sensor"].items()
    ]
    heads = ["Sensor", "gap beyond tolerances, before", "after", "noise alone"]
    words = paragraph(f"{wording.displacement_sentence(displacements)}.")
    return section("Displacements", words, table(heads, rows, (1, 2, 3), stacked=True) if rows else Html(""))


def site(sensor: Sensor) -> str:
    """Return the position of a sensor: in m on the screw, or the node that carries it."""
    return f"{sensor.position_m:g} m" if sensor.on is None else sensor.on


def _caption(first: int, log: str) -> str:
    return f"The proof, in {log}. Predictions run open loop: no reading corrects them." if first == 0 else ""


def _candidates(discovery: Discovery, result: dict[str, Any]) -> Html:
    """The ranking of the first round, and each of several effects compared with the next best."""
    chosen = {t.candidate.name for t in discovery.search.chosen}
    best = chosen | {c.name for answer in discovery.verdict.sets for c in answer}
    rows = [
        [
            Html(f"{code(wording.name_of(t))}<br>{safe(wording.lack_of(t['kind'], t['target']))}"),
            values(t),
            f"{t['evidence']:,.0f}",
            share(t["held_out_share"]),
            _standing(t, best, result["verdict"]),
        ]
        for t in result["ranking"]
    ]
    note = (
        "Evidence is the decrease of the misfit (twice the log-likelihood) when the effect is "
        f"added and all else refitted. To be accepted an effect must earn {ACCEPT:.0f}, and "
        f"{PER_PARAMETER:.0f} more "
        f"for each parameter beyond its first; explain {100 * MATERIAL:.0f} % of the misfit on parts of the "
        "logs that it was not fitted to; and stay off its bounds."
    )
    heads = ["Candidate, alone", "parameters (95 %)", "evidence", "explains, held out", ""]
    comparisons = [
        [code(trials[0].candidate.name), f"{trials[0].drop:,.0f}", *_next_best(trials[1:])]
        for trials in discovery.search.rivals
        if len(chosen) > 1
    ]
    heads_more = ["Effect, beside the others", "evidence", "next best in its place", "evidence"]
    return section(
        "Candidates",
        paragraph(note if rows else "No effect of the library promised to explain any of the rest.", "note"),
        table(heads, rows, (2,), stacked=True),
        table(heads_more, comparisons, (1, 3), stacked=True),
    )


def _standing(trial: dict[str, Any], best: set[str], verdict: str) -> str:
    if wording.name_of(trial) in best:
        return {"ambiguous": "as good", "unknown": "not enough"}.get(verdict, "chosen")
    if trial["at_bound"]:
        return "at a bound"
    return "not needed" if trial["accepted"] else "too little"


def _next_best(trials: Sequence[FittedCandidate]) -> tuple[str, str]:
    return (code(trials[0].candidate.name), f"{trials[0].drop:,.0f}") if trials else ("none", "")


def _parameters(discovery: Discovery, result: dict[str, Any]) -> Html:
    problem = discovery.problem
    configured = dict(zip(problem.keys, problem.free_values(problem.config).tolist(), strict=True))

    def row(name: str, p: dict[str, Any], before: str) -> list[str]:
        return [
            code(name),
            wording.interval(p["value"], *p["ci95"]),
            wording.unit_text(p["unit"]) or "–",
            before,
        ]

    rows = [
        row(f"{wording.name_of(e)}: {key}", p, "new")
        for e in result["effects"]
        for key, p in e["parameters"].items()
    ]
    rows += [row(key, p, f"{configured[key]:.4g}") for key, p in result["calibrated"].items()]
    written = " They stand in config.toml beside this page." if result["verdict"] == "named" else ""
    note = f"Fitted all together, with 95 % intervals.{written}"
    return section(
        "Parameters",
        paragraph(note, "note"),
        table(["Parameter", "value (95 %)", "unit", "as configured"], rows, (1, 3), stacked=True),
    )


def _limits(discovery: Discovery, logs: Sequence[str]) -> Html:
    """The use of each log, its missing rows, and the parameters that are not identifiable."""
    evidence = discovery.problem.evidence
    rows = []
    for i, (name, run) in enumerate(zip(logs, discovery.problem.forward.runs, strict=True)):
        of_log = evidence.run == i
        possible = run.ticks.measured_degC.size
        roles = (evidence.used, evidence.proof, evidence.fold == UNUSED)
        minutes = [_duration(evidence.time_s[of_log & role]) for role in roles]
        rows.append(
            [
                name,
                duration_text(run.run.duration_s),
                *minutes,
                f"{100 * (1 - of_log.sum() / possible):.1f} %",
            ]
        )
    sentence = "Every effect that was tried would show in these logs if it were strong enough."
    if discovery.search.blind:
        sentence = f"{wording.not_identifiable_sentence(discovery.search.blind)}."
    heads = ["Log", "lasts", "fitted", "held back as proof", "left out", "readings missing"]
    note = (
        "Proof was opened once, after everything was chosen. What is left out lies between fit and proof, so "
        "that the two are independent."
    )
    return section(
        "What was not used for fitting, and what is not identifiable from these logs",
        table(heads, rows, (1, 2, 3, 4, 5), stacked=True),
        paragraph(note, "note"),
        paragraph(sentence),
    )


def _duration(time_s: FloatArray) -> str:
    """The total length of the half minutes that end at these times."""
    return duration_text(len(np.unique(time_s)) * panels.MEAN_S) if len(time_s) else "–"


def _signed(value_K: float) -> str:
    return ("+" if value_K > 0 else "−") + wording.kelvin(abs(value_K))
