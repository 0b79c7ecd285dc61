"""The campaign of months: machines that are off their configuration within its tolerances are silent for a
month of working days, and what appears after a week is noticed. Rows that are there are not run again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from campaigns.gap.months import EFFECTS, Found, Rig
from campaigns.resumable import append_rows, read_rows, show
from tests.learning.machines import AS_CONFIGURED, Rough, draw

FIRST_SEED = 9200
ROUGH, PLAIN = 12, 1
DAYS, APPEARS = 30, 7
LOOKED = 3
"""Days of work after something appeared, in which it is looked for."""
NOTHING = "nothing"
COLUMNS = ("group", "machine", "appears", "days", "most", "after_h", "sensor", "phase")
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "gap" / "results.csv", DOCS / "evidence" / "alarms.md"
MARKS = ("<!-- the campaign's table, written by make gap-campaign -->", "<!-- its end -->")


def month(rig: Rig, group: str, number: int) -> list[dict[str, str]]:
    """One machine's rows: a month in which nothing appears, and what may appear after its first week."""
    one = draw(FIRST_SEED, number, Rough() if group == "rough" else AS_CONFIGURED)
    rig.begin()
    before = rig.days(one, FIRST_SEED, number, range(APPEARS))
    week = rig.watch.state
    after = rig.days(one, FIRST_SEED, number, range(APPEARS, DAYS))
    reported = before if before.sensor else after
    nothing = Found(max(before.most, after.most), reported.after_h, reported.sensor, reported.phase)
    rows = [_row(group, number, NOTHING, DAYS, nothing)]
    for effect in EFFECTS:
        rig.begin(week)
        days = range(APPEARS, APPEARS + LOOKED)
        rows.append(_row(group, number, effect, LOOKED, rig.days(one, FIRST_SEED, number, days, effect)))
    return rows


def _row(group: str, number: int, appears: str, days: int, found: Found) -> dict[str, str]:
    after_h = "" if found.after_h is None else f"{found.after_h:.2f}"
    cells = (
        group,
        number,
        appears,
        days,
        f"{found.most:.3f}",
        after_h,
        found.sensor or "",
        found.phase or "",
    )
    return dict(zip(COLUMNS, map(str, cells), strict=True))


def table(rows: list[dict[str, str]]) -> str:
    """The campaign in a table, a line for what appeared."""
    lines = [
        "| what appears | machines | reported | hours of work until then, median (longest) | reported first "
        "of a sensor beside it | largest gap over what is allowed, least … most |",
        "|---|---|---|---|---|---|",
    ]
    for group in ("rough", "as configured"):
        for appears in (NOTHING, *EFFECTS):
            own = [r for r in rows if (r["group"], r["appears"]) == (group, appears)]
            if not own:
                continue
            reported = [r for r in own if r["sensor"]]
            hours = [float(r["after_h"]) for r in reported]
            near = EFFECTS[appears][1] if appears in EFFECTS else ()
            most = [float(r["most"]) for r in own]
            spent = f"{np.median(hours):.1f} ({max(hours):.1f})" if hours else "–"
            beside = (
                f"{sum(r['sensor'] in near for r in reported)} of {len(reported)}"
                if reported and near
                else "–"
            )
            days = f", {own[0]['days']} days" if appears == NOTHING else ""
            lines.append(
                f"| {appears}{days} | {len(own)} {group} | {len(reported)} | {spent} | {beside} | "
                f"{min(most):.2f} … {max(most):.2f} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, and write the table into the page."""
    rig, console = Rig(), Console(stderr=True)
    done = {(r["group"], int(r["machine"])) for r in read_rows(RESULTS)}
    todo = [("as configured", i) for i in range(PLAIN)] + [("rough", i) for i in range(ROUGH)]
    for what in track([each for each in todo if each not in done], "machines", console=console):
        append_rows(RESULTS, month(rig, *what))
    show(PAGE, table(read_rows(RESULTS)), MARKS)


if __name__ == "__main__":
    main()
