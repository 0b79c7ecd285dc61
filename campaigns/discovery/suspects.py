"""The slice of the campaign about the logs: which suspects are reported, without the rest of a search."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from campaigns.discovery.summary import Share
from campaigns.resumable import Cells
from observer.align.aligner import AlignPlan, frames_of_log
from observer.align.unit_errors import in_configured_units
from observer.discovery.candidates import library, signatures
from observer.discovery.search import tried
from observer.discovery.suspects import Suspect, suspects
from observer.discovery.workers import IN_PROCESS
from observer.files.logs import Log
from observer.fit.hypothesis import fit_null
from observer.fit.parameters import free_keys
from observer.fit.problem import Problem
from observer.fit.runs import prepare
from observer.installation import parse
from tests.truth.machine.entries import Entry
from tests.truth.machine.generate import runs_of
from tests.truth.machine.logs import configuration
from tests.truth.machine.troubles import TROUBLES, Trouble, troubled

MANY, FEW = 0.9, 0.01
SAME = {"ambient": ("ambient_drift",), "offsets": ("sensor_bias",)}
"""Effects of the library that are the same thing as a suspect: there it is neither right nor wrong."""


@dataclass(frozen=True)
class SuspectRow:
    """One line of the table: what is wrong with the logs, what was reported, and whether it is so."""

    name: str
    trouble: str
    about: str
    by: str
    hidden: str
    logs: str
    typical: str
    reported: str
    reported_about: str
    reported_by: str
    outcome: str
    good: str
    search_s: str
    reason: str


def suspects_of(entry: Entry, trouble: Trouble) -> tuple[Suspect, ...]:
    """What is reported about the logs: by the first round of a search, and what stands before it."""
    case = entry.case
    config = parse(tomllib.loads(configuration(case.unmodelled, entry.without, known=not case.typical)))
    plan, prepared, corrected = AlignPlan.of(config), [], dict[Suspect, None]()
    for i, run in enumerate(trouble.runs):
        log, misread = in_configured_units(
            Log(Path(f"log {i + 1}"), run.time_s, run.channels, run.values), config
        )
        corrected |= {Suspect("units", m.channel, m.unit, m.text): None for m in misread}
        prepared.append(prepare(config, list(frames_of_log(log, plan)), f"log {i + 1}"))
    problem = Problem.of(config, free_keys(config), prepared)
    null = fit_null(problem, config)
    found = suspects(null, ())
    if found:  # effects only take suspects back
        known = library(config, problem.keys, config.discover.without, config.discover.also)
        marks = signatures(null.problem, null.config, known)
        found = suspects(null, tried(null, null, marks, (), IN_PROCESS), marks)
    return (*corrected, *found)


def try_suspect(entry: Entry, _answers: Path) -> SuspectRow:
    """Make the logs of a case, see what is reported about them, and judge it."""
    begin_s, reported, reason = time.monotonic(), tuple[Suspect, ...](), ""
    made = troubled(entry.case, entry.trouble) if entry.trouble else Trouble(runs_of(entry.case), ())
    try:
        reported = suspects_of(entry, made)
    except Exception as error:  # noqa: BLE001 - one case that fails must not end the campaign
        reason = f"{type(error).__name__}: {error}".replace("\n", " ")
    outcome = "failed" if reason else judged(entry, made.about, reported)
    return SuspectRow(
        name=entry.name,
        trouble=entry.trouble or "",
        about=" ".join(made.about),
        by=made.by,
        hidden=" ".join(e.kind for e in entry.case.effects),
        logs=str(entry.case.logs),
        typical=str(int(entry.case.typical)),
        reported="; ".join(s.what for s in reported),
        reported_about="; ".join(s.channel or "" for s in reported),
        reported_by="; ".join(str(s.by) for s in reported),
        outcome=outcome,
        good=str(int(outcome in ("right", "none", "same"))),
        search_s=f"{time.monotonic() - begin_s:.1f}",
        reason=reason,
    )


def judged(entry: Entry, about: Sequence[str], reported: Sequence[Suspect]) -> str:
    """What suspects amount to.

    right: that which is wrong and nothing else, of the right channels; extra: something else besides; missed:
    nothing; wrong: something else; none, same: rightly nothing, or what the hidden effect is.
    """
    hidden = {e.kind for e in entry.case.effects}
    same = {what for what, kinds in SAME.items() if hidden & set(kinds)}
    names = {s.what for s in reported}
    if entry.trouble is None:
        return "none" if not names else "same" if names <= same else "wrong"
    own = [s for s in reported if s.what == entry.trouble]
    if not own or any(channel not in (own[0].channel or "") for channel in about):
        return "wrong" if reported else "missed"
    return "right" if names == {entry.trouble} else "extra"


def suspect_summary(rows: Sequence[Cells]) -> str:
    """The table of the suspects: found among those made, named among others."""
    lines = [
        "| suspect | found of those made | 95 % bounds | ≥ 90 % | named in others | 95 % bounds | ≤ 1 % |",
        "|---|---|---|---|---|---|---|",
    ]
    for what in TROUBLES:
        made = [r for r in rows if r["trouble"] == what]
        same = SAME.get(what, ())
        others = [r for r in rows if r["trouble"] != what and not set(r["hidden"].split()) & set(same)]
        found = Share(sum(r["outcome"] in ("right", "extra") for r in made), len(made))
        named = Share(sum(what in r["reported"].split("; ") for r in others), len(others))
        one, other = _met(found, found.value >= MANY), _met(named, named.value <= FEW)
        lines.append(f"| {what} | {found} | {one} | {named} | {other} |")
    return "\n".join(lines) + "\n"


def _met(share: Share, met: bool) -> str:
    return ("yes" if met else "**no**") if share.of else "–"
