"""What became of the mutants: the results of a run, the survivors and their reasons, and the page."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from campaigns.mutants.nearest import ROOT

FOLDER = ROOT / "docs" / "mutants"
SURVIVORS, SUMMARY, PAGE = FOLDER / "survivors.csv", FOLDER / "summary.csv", ROOT / "docs" / "mutants.md"
MARK = "<!-- Below: written by `make mutants`. -->\n"
WITHOUT_REASON = "–"


@dataclass(frozen=True, slots=True)
class Survivor:
    """A mutant that the tests nearest to it let pass, and why that is right."""

    module: str
    line: int
    operator: str
    diff: str
    reason: str


@dataclass(frozen=True, slots=True)
class Count:
    """How many mutants a module has, and what became of those that were tried."""

    module: str
    mutants: int
    tried: int
    survived: int


class Results:
    """A file to which each trial is added at once, so that a run that was stopped goes on where it was."""

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        entries = [json.loads(line) for line in lines]
        self._known = {tuple(entry["key"]): entry["survived"] for entry in entries}

    def survived(self, *key: Any) -> bool | None:
        """Whether a mutant survived, None if it was not tried."""
        return self._known.get(key)

    def add(self, *key: Any, survived: bool) -> None:
        """Write down a trial."""
        self._known[key] = survived
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "survived": survived}) + "\n")


def survivors() -> list[Survivor]:
    """The survivors recorded in the documents."""
    return [Survivor(**row | {"line": int(row["line"])}) for row in _rows(SURVIVORS)]


def counts() -> list[Count]:
    """What the documents record of each module."""
    return [
        Count(row["module"], *(int(row[k]) for k in ("mutants", "tried", "survived")))
        for row in _rows(SUMMARY)
    ]


def merged(found: Sequence[Survivor], before: Sequence[Survivor], tried: set[str]) -> list[Survivor]:
    """The survivors found in the modules tried, with the reasons they had, beside those of other modules."""
    reasons = {(s.module, s.diff): s.reason for s in before}
    kept = [s for s in before if s.module not in tried]
    new = [
        Survivor(s.module, s.line, s.operator, s.diff, reasons.get((s.module, s.diff), s.reason))
        for s in found
    ]
    return sorted(kept + new, key=lambda s: (s.module, s.line, s.diff))


def write(found: Sequence[Survivor], counted: Sequence[Count]) -> None:
    """Write the survivors with their reasons, the counts, and the end of the page."""
    FOLDER.mkdir(exist_ok=True)
    _table(SURVIVORS, found)
    _table(SUMMARY, counted)
    head = PAGE.read_text(encoding="utf-8").split(MARK)[0]
    PAGE.write_text(head + MARK + page_end(counted), encoding="utf-8")


def page_end(counted: Sequence[Count]) -> str:
    """Return the sentence about the last run."""
    tried, alive = sum(c.tried for c in counted), sum(c.survived for c in counted)
    share = 100 * alive / max(tried, 1)
    return f"\n{tried} mutants of {len(counted)} modules were tried; {alive} survived, {share:.1f} %.\n"


def _rows(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _table(path: Path, rows: Iterable[Survivor | Count]) -> None:
    kind = Survivor if path == SURVIVORS else Count
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(kind.__dataclass_fields__), lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)
