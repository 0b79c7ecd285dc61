"""The campaign of machines that are off their configuration: what learning does for the estimates of each.

Half of them start cold, half in the middle of their day; each day runs once as delivered, and once by a
configuration that takes everything for known. Of one group each was calibrated first, on another day. The
last ones have their sensors on housings and nut only; in most of them the links are off as well. In the last
group faults of sensors are looked for, in all others not.
Rows that are there already are not run again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from campaigns.resumable import go_on, read_rows, show
from tests.learning.cover import QUANTITIES, calibrated, judged
from tests.learning.housings import HOUSED_CONFIG, draw_housed
from tests.learning.machines import AS_CONFIGURED, CONFIG, Rough, config_of, day, draw

FIRST_SEED = 4000
KNOWN = (
    "[tolerance]\nconductivity = 0.0\nheat_capacity = 0.0\nconvection = 0.0\nambient_K = 0.0\nend_W_K = 0.0\n"
    "position_m = 0.0\noffset_K = 0.0\nlag_s = 0.0\nlink = 0.0\ncapacity = 0.0\ngain = 0.0\n"
    "heat_per_log = 0.0\n[estimator]\nlearn = []\n"
)
CALIBRATED = "rough, calibrated"
UNSCREENED = "\n[integrity]\nenabled = false\n"
"""What drifting sensors add to σ is not what is judged in most groups."""
GROUPS = {"rough": Rough(), "as configured": AS_CONFIGURED, CALIBRATED: Rough()}
HOUSED = {
    "rough, on housings": (59000, 0.0, UNSCREENED),
    "the same, links 20 % off": (59000, 0.2, UNSCREENED),
    "others, links 20 % off": (62000, 0.2, UNSCREENED),
    "these, screened": (62000, 0.2, ""),
}
"""Machines with sensors on housings: their seed, what part links are off, whether faults are looked for."""
MACHINES = {"rough": 64, "as configured": 64, CALIBRATED: 48} | dict(
    zip(HOUSED, (16, 24, 12, 12), strict=True)
)
COLUMNS = ("group", "machine", "start", "quantity", "learns", "rms", "covered", "sigma")
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "learning" / "results.csv", DOCS / "evidence" / "learning.md"
MARKS = ("<!-- the campaign's table, written by make learning-campaign -->", "<!-- its end -->")


def tried(what: tuple[str, int]) -> list[dict[str, str]]:
    """One machine's rows."""
    group, number = what
    warm = number % 2 == 1
    if group in HOUSED:
        seed, links, more = HOUSED[group]
        machine, base = draw_housed(seed, number, links), HOUSED_CONFIG + more
    else:
        seed = FIRST_SEED
        machine, base = draw(seed, number, GROUPS[group]), CONFIG + UNSCREENED
    one = day(machine, seed, number, "abc"[number % 3], warm=warm)
    rows = []
    for learns, more in (("yes", ""), ("no", KNOWN)):
        text = base + more
        if group == CALIBRATED:
            text = calibrated(text, day(machine, FIRST_SEED, number, "abc"[(number + 1) % 3]))
        found = judged(config_of(text), one)
        for quantity in QUANTITIES:
            rms, covered, sigma = (f"{value:.4f}" for value in found[quantity])
            cells = (group, str(number), "warm" if warm else "cold", quantity, learns, rms, covered, sigma)
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows


def table(rows: list[dict[str, str]]) -> str:
    """The campaign in a table, a line for each group and quantity."""
    lines = [
        "| machines | quantity | rms error, known → learnt | ratio | 95 % intervals hold, mean | on the "
        "worst machine | σ, known → learnt |",
        "|---|---|---|---|---|---|---|",
    ]
    for group in MACHINES:
        for quantity in QUANTITIES:
            of = {
                learns: np.array(
                    [
                        [float(r["rms"]), float(r["covered"]), float(r["sigma"])]
                        for r in rows
                        if (r["group"], r["quantity"], r["learns"]) == (group, quantity, learns)
                    ]
                )
                for learns in ("yes", "no")
            }
            rms = {learns: float(np.sqrt(np.mean(a[:, 0] ** 2))) for learns, a in of.items()}
            unit = {"heats": "W", "nut": "W", "field": "K", "error": "µm"}[quantity]
            lines.append(
                f"| {len(of['yes'])} {group} | {quantity} | {rms['no']:.2f} → {rms['yes']:.2f} {unit} | "
                f"{rms['yes'] / rms['no']:.2f} | {100 * of['yes'][:, 1].mean():.0f} % (known: "
                f"{100 * of['no'][:, 1].mean():.0f} %) | {100 * of['yes'][:, 1].min():.0f} % | "
                f"{of['no'][:, 2].mean():.2f} → {of['yes'][:, 2].mean():.2f} {unit} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, two at a time, and write the table into the page."""
    done = {(r["group"], int(r["machine"])) for r in read_rows(RESULTS)}
    todo = [(g, i) for g in MACHINES for i in range(MACHINES[g]) if (g, i) not in done]
    go_on(todo, tried, RESULTS, Console(stderr=True))
    show(PAGE, table(read_rows(RESULTS)), MARKS)


if __name__ == "__main__":
    main()
