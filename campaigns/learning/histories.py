"""The campaign of whole logs: how often the true heats lie within what `identify` says of them.

Machines off their configuration as in `trial`, of seeds of their own; each day is identified as delivered,
and once by a configuration that takes everything for known. Rows that are there already are not run again.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from rich.console import Console

from campaigns.learning.trial import DOCS, KNOWN
from campaigns.resumable import go_on, read_rows, show
from observer.align.aligner import frames_of_log
from observer.config.machine import Config
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import inputs_of
from observer.frames import FloatArray
from observer.history.history import HeatHistory, MethodOptions
from observer.history.identify import heat_history
from observer.history.tolerances import changes_within
from tests.learning.cover import FROM_S, TWO_SIDED_95, log_of
from tests.learning.machines import CONFIG, Day, Rough, config_of, day, draw

FIRST_SEED = 13000
MACHINES = 16
COLUMNS = ("machine", "start", "quantity", "tolerances", "rms", "covered", "sigma")
RESULTS, PAGE = DOCS / "learning" / "identify.csv", DOCS / "evidence" / "learning.md"
MARKS = ("<!-- the campaign's table, written by make identify-campaign -->", "<!-- its end -->")


def identified(config: Config, day_: Day, method: MethodOptions | None = None) -> HeatHistory:
    """What `identify` finds of a day."""
    machine = MachineModel.of(config)
    blocks = inputs_of(frames_of_log(log_of(day_), machine.plan), machine.drive)
    within = partial(changes_within, config, blocks)
    return heat_history(machine.plant, config.estimator, blocks, method or MethodOptions(), within)


def covered(history: HeatHistory, day_: Day) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each heat from ten minutes on (3,): the rms error, the part within the 95 % band, the mean σ; W."""
    late = day_.time_s - day_.time_s[0] >= FROM_S
    error_W, sigma_W = (history.heat_W - day_.heat_W)[late], history.heat_sigma_W[late]
    inside = np.abs(error_W) <= TWO_SIDED_95 * sigma_W
    return np.sqrt(np.mean(error_W**2, axis=0)), inside.mean(axis=0), sigma_W.mean(axis=0)


def tried(number: int) -> list[dict[str, str]]:
    """One machine's rows."""
    warm = number % 2 == 1
    machine = draw(FIRST_SEED, number, Rough())
    one = day(machine, FIRST_SEED, number, "abc"[number % 3], warm=warm)
    rows = []
    for tolerances, more in (("as delivered", ""), ("none", KNOWN)):
        rms, part, sigma = covered(identified(config_of(CONFIG, more), one), one)
        for i, quantity in enumerate(("nut", "left bearing", "right bearing")):
            values = (f"{value:.4f}" for value in (rms[i], part[i], sigma[i]))
            cells = (str(number), "warm" if warm else "cold", quantity, tolerances, *values)
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows


def table(rows: list[dict[str, str]]) -> str:
    """The campaign in a table, a line for each heat and one for all."""
    lines = [
        "| heat | rms error, known → within tolerances | 95 % bands hold, mean (known) | on the worst "
        "machine | σ, known → within tolerances |",
        "|---|---|---|---|---|",
    ]
    quantities = list(dict.fromkeys(r["quantity"] for r in rows))
    for name, of in [(q, (q,)) for q in quantities] + [("all", tuple(quantities))]:
        a, b = (
            np.array(
                [
                    np.mean(
                        [
                            [float(r["rms"]) ** 2, float(r["covered"]), float(r["sigma"])]
                            for r in rows
                            if (r["machine"], r["tolerances"]) == (machine, tolerances)
                            and r["quantity"] in of
                        ],
                        axis=0,
                    )
                    for machine in dict.fromkeys(r["machine"] for r in rows)
                ]
            )
            for tolerances in ("as delivered", "none")
        )
        rms_W, known_W = np.sqrt(a[:, 0].mean()), np.sqrt(b[:, 0].mean())
        lines.append(
            f"| {name} | {known_W:.2f} → {rms_W:.2f} W | {100 * a[:, 1].mean():.0f} % "
            f"({100 * b[:, 1].mean():.0f} %) | {100 * a[:, 1].min():.0f} % | "
            f"{b[:, 2].mean():.2f} → {a[:, 2].mean():.2f} W |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, and write the table into the page."""
    done = {int(r["machine"]) for r in read_rows(RESULTS)}
    go_on([i for i in range(MACHINES) if i not in done], tried, RESULTS, Console(stderr=True), workers=1)
    show(PAGE, table(read_rows(RESULTS)), MARKS)


if __name__ == "__main__":
    main()
