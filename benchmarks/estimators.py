"""Estimators side by side on machines whose truth is independent: `python -m benchmarks.estimators`.

Every machine is off its configuration as real ones are, with errors of film, friction and sensors that no log
reveals.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from observer.errors import UserError
from observer.installation import parse
from tests.learning.cover import TWO_SIDED_95, estimates, misses
from tests.learning.machines import CONFIG, Day, Rough, day, draw

SEED = 9000
"""Not one of the campaigns' seeds."""
OWN = ("kalman", "luenberger")
QUANTITIES = {"heats": "heat, W", "field": "field, K", "error": "error, µm"}


def measured(kind: str, days: Sequence[Day]) -> dict[str, float]:
    """What an estimator is worth over days: by quantity its rms error and the part within its 95 % interval,
    NaN for what it does not estimate, and how long the fastest replay took, in µs a step.

    Raises `UserError` where `kind` is none.
    """
    config = parse(tomllib.loads(f'{CONFIG}\n[estimator]\nkind = "{kind}"\n'), kind)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in QUANTITIES}
    step_s: list[float] = []
    for one in days:
        begun_s = time.perf_counter()
        block = estimates(config, one)
        step_s.append((time.perf_counter() - begun_s) / len(one.time_s))
        for name in QUANTITIES:
            error, sigma = misses(block, one)[name]
            known = np.isfinite(error)
            within = np.abs(error[known]) <= TWO_SIDED_95 * sigma[known]
            if known.any():
                found[name].append((float(np.mean(error[known] ** 2)), float(within.mean())))
    row = {"step_us": 1e6 * min(step_s)}
    for name, pairs in found.items():
        square, covered = np.mean(pairs, axis=0) if pairs else (np.nan, np.nan)
        row |= {f"{name}_rms": float(np.sqrt(square)), f"{name}_covered": float(covered)}
    return row


def compared(kinds: Sequence[str], machines: int) -> Table:
    """A table of estimators, a row each, over the first machines."""
    days = [day(draw(SEED, n, Rough()), SEED, n, "abc"[n % 3], warm=n % 2 == 1) for n in range(machines)]
    table = Table("estimator", title=f"{machines} machines, from ten minutes on: rms error, within 95 %")
    for words in (*QUANTITIES.values(), "replay, µs a step"):
        table.add_column(words, justify="right")
    for kind in kinds:
        row = measured(kind, days)
        cells = (_cell(row[f"{name}_rms"], row[f"{name}_covered"]) for name in QUANTITIES)
        table.add_row(kind, *cells, f"{row['step_us']:.1f}")
    return table


def _cell(rms: float, covered: float) -> str:
    return f"{rms:.2f}, {100 * covered:.0f} %" if np.isfinite(rms) else "not estimated"


def main(words: Sequence[str]) -> int:
    """Compare; returns the exit code."""
    parser = argparse.ArgumentParser("python -m benchmarks.estimators")
    parser.add_argument("--estimator", action="append", default=[], help='Your own, "module:Class".')
    parser.add_argument("--machines", type=int, default=4, help="On how many.")
    given = parser.parse_args(words)
    if given.machines < 1:
        parser.error("--machines: give one or more")
    try:
        Console().print(compared([*OWN, *given.estimator], given.machines))
    except UserError as error:
        print(f"benchmarks.estimators: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
