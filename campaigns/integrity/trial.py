"""The campaign of faults in values: `make integrity`, or go on where it was stopped.

Every fault of the catalogue on each of twelve machines that are as rough as `[tolerance]` says, from 4000 s
of their day on; and a simulated month in which nothing is wrong. Rows that are there are not run again;
`--try` prints the table of chosen faults and machines and keeps nothing.
"""

from __future__ import annotations

import argparse
import csv
import io
from pathlib import Path

import numpy as np
from rich.console import Console

from campaigns.integrity.catalogue import GROUP_OF, GROUPS, HOUSINGS, NEW_PROGRAM, NONE, catalogue
from campaigns.integrity.judge import Verdict, judged
from campaigns.integrity.promise import MONTH_H, Row, short_of, total
from campaigns.integrity.rates import rates
from campaigns.resumable import go_on, read_rows, show

MACHINES, CALM, NEW_PROGRAMS, HOUSED = 12, 300, 48, 4
"""How many machines have each fault, how many have none, how many change their strokes, and how many with
sensors on housings have each of theirs.
"""
COLUMNS = ("fault", "machine", *Verdict._fields)
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "integrity" / "results.csv", DOCS / "evidence" / "integrity.md"
MARKS = ("<!-- how often the bound failed, written by make integrity -->", "<!-- end of the rates -->")


def tried(what: tuple[str, int]) -> list[Row]:
    """The row of one machine with one fault."""
    name, number = what
    return [row_of(name, number, judged(catalogue()[name], number))]


def row_of(name: str, number: int, verdict: Verdict) -> Row:
    """A verdict as a row of the table that is kept."""
    cells = ("" if v is None else f"{v:.4g}" if isinstance(v, float) else str(v) for v in verdict)
    return dict(zip(COLUMNS, (name, str(number), *cells), strict=True))


def _share(rows: list[Row], column: str, of: str) -> str:
    """A part in percent over all machines, and that of the worst machine."""
    if not all(r[column] for r in rows):
        return "–"
    whole = total(rows, of)
    if whole == 0.0:
        return "–"
    worst = max(float(r[column]) / float(r[of]) for r in rows if float(r[of]) > 0.0)
    return f"{_percent(total(rows, column) / whole)} ({_percent(worst)})"


def _percent(share: float) -> str:
    """A share in percent, of small ones two digits."""
    percent = 100.0 * share
    return f"{percent:.0f}" if percent >= 10.0 or percent == 0.0 else f"{percent:.2g}"


def _after(rows: list[Row], column: str) -> str:
    """How long it took: median, the longest, and on how many machines."""
    seconds = [float(r[column]) for r in rows if r[column]]
    if not seconds:
        return "never"
    missing = "" if len(seconds) == len(rows) else f", on {len(seconds)} of {len(rows)}"
    return f"{np.median(seconds):.0f} s ({max(seconds):.0f} s{missing})"


def _mean(rows: list[Row], column: str) -> str:
    known = [float(r[column]) for r in rows if r[column] and r[column] != "nan"]
    return f"{np.mean(known):.1f}" if known else "–"


def _right(rows: list[Row]) -> str:
    named = [r for r in rows if r["named_s"]]
    return f"{sum(r['right'] == 'yes' for r in named)} of {len(named)}" if named else "–"


def table(rows: list[Row]) -> str:
    """The campaign in a table, a line for each fault."""
    lines = [
        "| fault | machines | good | of the good beyond the bound (worst machine) | beyond 3 σ | farthest, σ "
        "| farthest error, µm | not good after, median (longest) | a sensor out after | just those at fault "
        "| half width, bound at the end, µm |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for group, names in _groups(rows):
        lines.append(f"| *{group}* | | | | | | | | | | |")
        for name in names:
            own = [r for r in rows if r["fault"] == name]
            cells = (
                name,
                str(len(own)),
                f"{_percent(total(own, 'good') / total(own, 'steps'))} %",
                _with_unit(_share(own, "beyond", "good")),
                _with_unit(_share(own, "wrong", "good")),
                f"{max(float(r['sigmas']) for r in own):.1f}",
                f"{max(float(r['worst_um']) for r in own):.1f}",
                _after(own, "bad_s"),
                _after(own, "named_s"),
                _right(own),
                f"{_mean(own, 'half_um')}, {_mean(own, 'bound_um')}",
            )
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, "", *_calm(rows)])


def _with_unit(share: str) -> str:
    return share if share == "–" else share.replace(" (", " % (").replace(")", " %)")


def _groups(rows: list[Row]) -> list[tuple[str, list[str]]]:
    """The groups that rows are of, each with its faults in the order of the catalogue."""
    there = {r["fault"] for r in rows}
    return [
        (group, names)
        for group in GROUPS
        if (names := [name for name, own in GROUP_OF.items() if own == group and name in there])
    ]


def _calm(rows: list[Row]) -> list[str]:
    """What is said where nothing is wrong, by the month."""
    calm = [r for r in rows if r["fault"] == NONE]
    if not calm:
        return []
    hours, out = total(calm, "steps") / 3600.0, total(calm, "out")
    good = _percent(total(calm, "good") / total(calm, "steps"))
    least = _percent(min(float(r["good"]) / float(r["steps"]) for r in calm))
    return [
        f"Without a fault, over {hours:.0f} h of {len(calm)} machines, a sensor was taken out "
        f"{out:.0f} times, {out * MONTH_H / hours:.1f} in a simulated month; {good} % good, "
        f"on the worst machine {least} %.",
    ]


def machines_of(name: str) -> range:
    """On which machines a fault is tried."""
    usual = HOUSED if GROUP_OF[name] == HOUSINGS else MACHINES
    return range({NONE: CALM, NEW_PROGRAM: NEW_PROGRAMS}.get(name, usual))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--faults", default="", help="names, or parts of names or of groups, by ';'; all")
    parser.add_argument("--machines", type=int, help="on so many machines each; as the campaign has them")
    parser.add_argument("--try", dest="only_try", action="store_true", help="print the table, keep nothing")
    parser.add_argument("--folder", type=Path, help="where results go instead of docs/")
    parser.add_argument("--anew", action="store_true", help="forget what has been run, for another estimator")
    parser.add_argument("--list", action="store_true", help="the faults' names")
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args()


def chosen(parts: str) -> list[str]:
    """The names of the faults that are meant: a whole name or group, else all that have the part in them."""
    faults = catalogue()
    found: list[str] = []
    for part in filter(None, (p.strip() for p in parts.split(";"))):
        whole = [f.name for f in faults.values() if part in (f.name, f.group)]
        own = whole or [f.name for f in faults.values() if part in f.name]
        if not own:
            raise SystemExit(f"no fault {part!r}; --list names them")
        found += [name for name in own if name not in found]
    return found or list(faults)


def _print_tried(names: list[str], machines: int | None) -> None:
    """Run some here and now, and print their table."""
    rows = [
        row
        for name in names
        for number in (range(machines) if machines else machines_of(name))
        for row in tried((name, number))
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    print(text.getvalue(), table(rows), *short_of(rows), sep="\n")


def main() -> None:
    """Run what is missing, two at a time, and write the table into the page."""
    options = _options()
    names = chosen(options.faults)
    if options.list:
        print("\n".join(f"{name}  [{catalogue()[name].group}]" for name in names))
        return
    if options.only_try:
        _print_tried(names, options.machines)
        return
    folder: Path | None = options.folder
    results = folder / "results.csv" if folder else RESULTS
    if options.anew:
        results.unlink(missing_ok=True)
    done = {(r["fault"], int(r["machine"])) for r in read_rows(results)}
    wanted = [(name, n) for name in names for n in machines_of(name)[: options.machines]]
    wanted.sort(key=lambda what: what[1])  # a machine's day is made once for all of its faults
    go_on([w for w in wanted if w not in done], tried, results, Console(stderr=True), options.workers)
    rows = read_rows(results)
    if folder is None:
        show(PAGE, rates(rows), MARKS)
    print(table(rows), rates(rows), *short_of(rows), sep="\n")


if __name__ == "__main__":
    main()
