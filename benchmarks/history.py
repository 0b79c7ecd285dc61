"""Ratios kept from commit to commit, and this run's beside the last of them.

Times are not kept: computers differ, and so does what else they do. A ratio to what was measured in the same
run stays comparable.
"""

from __future__ import annotations

import csv
import datetime
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from benchmarks.table import Result

ROOT = Path(__file__).parents[1]
PLACE = Path("docs/benchmarks/history.csv")
WORSE = 1.2
"""A ratio that got worse by more than this factor is marked."""


@dataclass(frozen=True, slots=True)
class Kept:
    """One ratio of one run; `commit` ends in + where files had been changed; `better` is more or less."""

    date: str
    commit: str
    work: str
    ratio: float
    better: str = "more"


@dataclass(frozen=True, slots=True)
class Compared:
    """A row beside the last one kept of the same work; `before` is None where there is none."""

    work: str
    now: float | None
    before: Kept | None
    worse: bool

    @property
    def kept_text(self) -> str:
        """The ratio kept and its commit, empty where there is none."""
        return f"{self.before.ratio:.3g} × ({self.before.commit})" if self.before else ""

    @property
    def shown(self) -> str:
        """The same, marked where it got worse."""
        return f"[bold red]{self.kept_text}[/]" if self.worse else self.kept_text


def named(results: Sequence[Result]) -> list[Result]:
    """The rows under names of their own: a row that is set in belongs to the last one that is not."""
    above, rows = "", []
    for row in results:
        if not row.work.startswith(" "):
            above = row.work
        work = f"{above}: {row.work.strip()}" if row.work.startswith(" ") else row.work
        rows.append(Result(**asdict(row) | {"work": work}))
    return rows


def compare(rows: Sequence[Result], kept: Sequence[Kept]) -> list[Compared]:
    """Each row beside what was kept last of the same work."""
    last = {each.work: each for each in kept}
    return [
        Compared(row.work, row.times, last.get(row.work), _worse(row, last.get(row.work))) for row in rows
    ]


def _worse(row: Result, before: Kept | None) -> bool:
    if row.times is None or before is None:
        return False
    return before.ratio > WORSE * row.times if row.more else row.times > WORSE * before.ratio


def merged(kept: Sequence[Kept], rows: Sequence[Result], date: str, commit: str) -> list[Kept]:
    """What is kept after a run: another run of the same commit takes the place of the first."""
    new = [
        Kept(date, commit, row.work, float(f"{row.times:.4g}"), "more" if row.more else "less")
        for row in rows
        if row.times is not None
    ]
    again = {(each.commit, each.work) for each in new}
    return [each for each in kept if (each.commit, each.work) not in again] + new


def read(path: Path = ROOT / PLACE) -> list[Kept]:
    """What was kept, the oldest first."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [
            Kept(r["date"], r["commit"], r["work"], float(r["ratio"]), r["better"])
            for r in csv.DictReader(file)
        ]


def keep(results: Sequence[Result], path: Path = ROOT / PLACE) -> None:
    """Write this run's ratios to those kept."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    rows = merged(read(path), named(results), today, _commit())
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(Kept)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def _commit() -> str:
    """The commit that was measured; with + if the files are not quite that."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        changed = git(
            "status", "--porcelain", "--untracked-files=no", "--", "observer", "drivers", "benchmarks"
        )
        return git("rev-parse", "--short=10", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
