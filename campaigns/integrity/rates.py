"""How often the bound failed: an hour and by runs, with upper limits."""

from __future__ import annotations

from scipy.stats import beta, chi2

from campaigns.integrity.catalogue import GROUP_OF, GROUPS, LEGITIMATE
from campaigns.integrity.promise import Row, total

CONFIDENCE = 0.95
HEAD = (
    "| class | runs | good hours | steps that are good | good steps beyond 3 σ | good steps beyond the bound "
    "| excursions | an hour (upper limit) | runs with any (upper limit) |",
    "|---|---|---|---|---|---|---|---|---|",
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
    good, steps, wrong = (total(members, column) for column in ("good", "steps", "wrong"))
    shares = f"{100.0 * good / steps:.0f} % | {f'{100.0 * wrong / good:.2g} %' if good else '–'}"
    return f"| {name} | {runs} | {hours:.0f} | {shares} | {beyond} | {excursions} | {an_hour} | {share} |"
