"""One case of the campaign: hide, search, judge."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaigns.discovery.judge import estimates, is_good, is_localised, outcome_of
from campaigns.discovery.showing import Showing, showing_of
from campaigns.resumable import Rows
from tests.truth.machine.entries import Entry
from tests.truth.machine.generate import write_answer, write_case


@dataclass(frozen=True)
class Row:
    """One line of the campaign's table.

    `shows_K`, `shows_sigma`: what is left of the hidden thing at the sensors once the user's parameters are
    refitted, and the same over the noise of a sample. `errors`, `covered`: key=value of each parameter found,
    joined by spaces. `localised`: whether place and phase were found, where the answer was "unknown".
    """

    name: str
    group: str
    label: str
    rung: str
    strength: str
    hidden: str
    shows_K: str
    shows_sigma: str
    verdict: str
    named: str
    alternatives: str
    outcome: str
    good: str
    errors: str
    covered: str
    localised: str
    before_K: str
    after_K: str
    floor_K: str
    search_s: str
    reason: str


def search(entry: Entry, folder: Path) -> tuple[dict[str, Any], float]:
    """Write a case's logs, let the workflow search them; return its result and the seconds that it took."""
    from observer import discover

    logs = write_case(entry.case, folder / "logs", entry.without)
    begin_s = time.monotonic()
    config = folder / "logs" / "config.toml"
    result = discover(config, logs).write(folder / "found", report=False)
    return result, time.monotonic() - begin_s


def try_entry(entry: Entry, answers: Path) -> Row:
    """Search a case and judge the result; the answer is written once the search is over, elsewhere.

    A search that raises is a row too: "failed", with its reason.
    """
    result: dict[str, Any] | None = None
    seconds, reason = 0.0, ""
    with TemporaryDirectory() as folder:
        try:
            result, seconds = search(entry, Path(folder))
        except Exception as error:  # noqa: BLE001 - one search that fails must not end the campaign
            reason = f"{type(error).__name__}: {error}".replace("\n", " ")
    write_answer(entry.case, answers, entry.name)
    return judged(entry, result, showing_of(entry.case), seconds, reason)


def rows_of(trial: Callable[[Entry, Path], Any], answers: Path, entry: Entry) -> Rows:
    """The row of a case that is tried in a process of its own: a dataclass as cells."""
    return [asdict(trial(entry, answers))]


def judged(
    entry: Entry, result: dict[str, Any] | None, showing: Showing, seconds: float, reason: str = ""
) -> Row:
    """The line of a case with its result, or without one."""
    outcome = "failed" if result is None else outcome_of(entry, result)
    result = result or {"verdict": "", "effects": [], "alternatives": [], "where": [], "gap": {}}
    found, gap = estimates(entry, result), result["gap"]
    localised = is_localised(result, showing.sensors, showing.phases) if outcome == "unknown" else None
    return Row(
        name=entry.name,
        group=entry.group,
        label=entry.label,
        rung="" if entry.rung is None else str(entry.rung + 1),
        strength="" if entry.strength is None else f"{entry.strength:g}",
        hidden=_names((e.kind, e.target) for e in entry.case.effects),
        shows_K=f"{showing.rms_K:.4f}",
        shows_sigma=f"{showing.sigma:.2f}",
        verdict=str(result["verdict"]),
        named=_names((e["kind"], e.get("target")) for e in result["effects"]),
        alternatives=" | ".join(" ".join(map(str, names)) for names in result["alternatives"]),
        outcome=outcome,
        good=str(int(is_good(entry, outcome))),
        errors=" ".join(f"{e.key}={e.error:.4f}" for e in found),
        covered=" ".join(f"{e.key}={int(e.covered)}" for e in found),
        localised="" if localised is None else str(int(localised)),
        before_K=_number(gap.get("before_rms_K")),
        after_K=_number(gap.get("after_rms_K")),
        floor_K=_number(gap.get("floor_rms_K")),
        search_s=f"{seconds:.1f}",
        reason=reason,
    )


def _names(names: Any) -> str:
    return " ".join(kind if target is None else f"{kind}@{target}" for kind, target in names)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"
