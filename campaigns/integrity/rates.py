"""How often the bound failed: an hour and by runs, with upper limits, and which version was measured."""

from __future__ import annotations

import datetime
import json
import subprocess
from importlib.metadata import version
from pathlib import Path

from scipy.stats import beta, chi2

from campaigns.integrity.catalogue import GROUP_OF, GROUPS, LEGITIMATE
from campaigns.integrity.promise import Row, total

CONFIDENCE = 0.95
HEAD = (
    "| class | runs | good hours | good steps beyond the bound | excursions | an hour (upper limit) "
    "| runs with any (upper limit) |",
    "|---|---|---|---|---|---|---|",
)


def most_expected(count: int) -> float:
    """Return the upper limit of the expected number of events of which `count` came (exact Poisson)."""
    return float(chi2.ppf(CONFIDENCE, 2 * (count + 1)) / 2.0)


def most_share(count: int, runs: int) -> float:
    """Return the upper limit of the share of runs, of which `count` had an event (Clopper and Pearson)."""
    return 1.0 if count == runs else float(beta.ppf(CONFIDENCE, count + 1, runs - count))


def rates(rows: list[Row]) -> str:
    """Return the table of how often good steps were beyond their bound, a line for each class."""
    classes = [(name, [r for r in rows if r["fault"] == name]) for name in LEGITIMATE]
    classes += [
        (group, [r for r in rows if GROUP_OF[r["fault"]] == group and r["fault"] not in LEGITIMATE])
        for group in GROUPS
    ]
    return "\n".join([*HEAD, *(_line(name, members) for name, members in classes if members)])


def _line(name: str, members: list[Row]) -> str:
    hours, runs = total(members, "good") / 3600.0, len(members)
    excursions = int(total(members, "excursions"))
    having = sum(float(r["excursions"]) > 0.0 for r in members)
    an_hour = f"{excursions / hours:.2g} ({most_expected(excursions) / hours:.2g})" if hours else "–"
    share = f"{having} ({100.0 * most_share(having, runs):.2g} %)"
    beyond = f"{total(members, 'beyond'):.0f}"
    return f"| {name} | {runs} | {hours:.0f} | {beyond} | {excursions} | {an_hour} | {share} |"


def note_run(file: Path) -> None:
    """Write down what is being measured: version, date and commit."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short=8", "HEAD"],
        cwd=Path(__file__).parent, check=True, capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    facts = {"version": version("ballscrew-observer"), "date": today, "commit": commit}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")


def caption(file: Path) -> str:
    """Return the sentence that says what was measured, empty where that was not written down."""
    if not file.exists():
        return ""
    facts = json.loads(file.read_text(encoding="utf-8"))
    return f"Measured on {facts['date']} with version {facts['version']}, commit `{facts['commit']}`."
