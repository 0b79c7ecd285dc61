"""The campaign in tables: a line for each shift, and the goals beside the measured figures."""

from __future__ import annotations

from collections.abc import Sequence

from campaigns.first_day.promise import PROMISES, Row, share, total
from campaigns.integrity.rates import most_expected

MARKS = ("<!-- the first day, written by make first-day -->", "<!-- end of the first day -->")
SHOWN = (
    "machine", "hours", "first_good_s", "steps", "good", "beyond_3_sigma", "grown_beyond_3_sigma", "worst_um",
    "rms_um", "last_um", "bounded", "excursions", "jumps", "exclusions", "armed_s", "released", "replay_s",
)  # fmt: skip
WIDTH = 9


def machines_table(rows: Sequence[Row]) -> str:
    """Return a line for each shift of a machine, in fixed columns."""
    heads = [name.removesuffix("_s")[-WIDTH:] if len(name) > WIDTH else name for name in SHOWN]
    lines = [" ".join(f"{head:>{WIDTH}}" for head in heads)]
    ordered = sorted(rows, key=lambda row: (float(row["shift_h"]), int(row["machine"])))
    lines += [" ".join(f"{row[name][:WIDTH] or '–':>{WIDTH}}" for name in SHOWN) for row in ordered]
    lines += [f"{row['machine']}: {row['not_good']}" for row in ordered if row["not_good"]]
    return "\n".join(lines)


def promises_table(rows: Sequence[Row]) -> str:
    """Return the goals beside the measured figures, and how often the bound failed."""
    if not rows:
        goals = (f"| {promise.words} | {promise.goal} |" for promise in PROMISES)
        return "\n".join(["| not measured yet | goal |", "|---|---|", *goals])
    machines = len({row["machine"] for row in rows})
    lines = [
        f"| {machines} machines, {total(rows, 'hours'):.3g} h | measured | goal | |",
        "|---|---|---|---|",
    ]
    for promise in PROMISES:
        verdict = "" if promise.met(rows) else "missed"
        lines.append(f"| {promise.words} | {promise.figure(rows):.3g} | {promise.goal} | {verdict} |")
    grown = share(rows, "grown_beyond_3_sigma", "good")
    lines.append(f"| the same, if the error is the growth since the start, % | {grown:.3g} | measured | |")
    hours = total(rows, "bounded") / 3600.0
    count = int(total(rows, "excursions"))
    rate = f"{count / hours:.2g} an hour, at most {most_expected(count) / hours:.2g}" if hours else "–"
    lines.append(f"| runs of good steps beyond a published bound, in {hours:.3g} h | {rate} | measured | |")
    return "\n".join(lines)
