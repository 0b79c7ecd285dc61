"""The frame of a discovery's report: verdict and figures at the top, the next step, and its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from observer.discovery.discover import Discovery
from observer.report import wording
from observer.report.page import Html, code, command, paragraph, safe, section, table, tiles


def header(discovery: Discovery, result: dict[str, Any], logs: Sequence[str]) -> Html:
    """Return the verdict, and the figures that it rests on.

    Args:
        discovery: The search.
        result: The content of `result.json`.
        logs: The names of the logs.
    """
    machine, gap = discovery.problem.config.machine, result["gap"]
    of = f"{machine.name}, axis {machine.axis}"
    date = f", {result['date'][:10]}" if "date" in result else ""
    first = (
        ("as configured", "as_given") if gap["before_rms_K"] == gap["after_rms_K"] else ("before", "before")
    )
    facts = [
        (f"Gap on data held back, {first[0]} → now", arrow(gap[f"{first[1]}_rms_K"], gap["after_rms_K"])),
        ("Of it beyond tolerances", excess_text(gap)),
        ("Noise of the sensors alone", wording.kelvin(gap["floor_rms_K"])),
        ("Logs", f"{len(logs)}, the last kept as proof" if len(logs) > 1 else "1, its end kept as proof"),
    ]
    if (worth := result["worth"]) is not None:
        error = f"{wording.um(worth['before_rms_um'])} → {wording.um(worth['after_rms_um'])}"
        facts.insert(1, ("As thermal error, rms at the worst place", error))
    facts += [(wording.name_of(e), values(e)) for e in result["effects"]]
    partial = "" if result["partial"] is None else f" {wording.partial_sentence(result['partial'])}."
    happened = wording.event_of(result)
    event = "" if happened is None else f" {wording.event_sentence(happened, logs[happened['log'] - 1])}."
    sure = "" if result["verdict"] in ("named", "none") else ' class="doubt"'
    verdict, gap_left = wording.headline(discovery.verdict, result), wording.gap_sentence(result)
    return Html(
        f'<header{sure}><p class="of">{safe(of)}: what the model lacks<span class="whole">{date}</span></p>'
        f"<h1>{safe(verdict)}.</h1>{paragraph(f'{gap_left}.{partial}{event}')}{tiles(facts)}</header>"
    )


def next_step(result: dict[str, Any]) -> Html:
    """Return the section with the next step and its command, and the definition of the thermal error."""
    step, worth = result.get("next"), result["worth"]
    meant = (
        Html("")
        if worth is None
        else paragraph(f"{wording.worth_sentence(worth)}. {wording.WORTH_NOTE}", "note")
    )
    if step is None:
        return section("What it is worth", meant)
    parts = [paragraph(f"{step['text']}{':' if step['command'] else '.'}")]
    parts += [command(step["command"])] if step["command"] else []
    return section("What to do next, and what it is worth", *parts, meant)


def made_of(result: dict[str, Any]) -> Html:
    """Return the section with the inputs of the page: date, version, hash of the configuration, logs."""
    rows = [
        [name, Html(code(str(result[key])))]
        for name, key in (
            ("Date", "date"),
            ("Version", "version"),
            ("Configuration, SHA-256", "config_sha256"),
        )
        if key in result
    ]
    if "logs" in result:
        rows.append(["Logs", in_lines(result["logs"])])
    return section("Made of", table(["", ""], rows, stacked=True))


def values(effect: dict[str, Any]) -> Html:
    """Return an effect's parameters with their 95 % intervals and units, a line each."""
    return in_lines([f"{key} {wording.measured(p)}" for key, p in effect["parameters"].items()])


def in_lines(parts: Sequence[str]) -> Html:
    """Return texts, each on a line of its own; they are escaped."""
    return Html("<br>".join(map(safe, parts)))


def arrow(before_K: float, after_K: float) -> str:
    """Return a gap before and after, as `2.3 K → 0.07 K`."""
    return f"{wording.kelvin(before_K)} → {wording.kelvin(after_K)}"


def excess_text(gap: dict[str, Any]) -> str:
    """Return the part of a gap that no tolerance explains, in K.

    It has two values if effects change it: calibrated without an effect, and with those found.

    Args:
        gap: An entry of `gap` in `result.json`, of all sensors or of one.
    """
    before_K, after_K = (gap["beyond_tolerances"][f"{key}_rms_K"] for key in ("before", "after"))
    return wording.kelvin(after_K) if before_K == after_K else arrow(before_K, after_K)
