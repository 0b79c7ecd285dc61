"""`python -m campaigns.releases`: a thousand drawn faults over a day of an armed compensation.

The thresholds are the promises of `campaigns.releases.axis`, which every step asserts: the first broken one
ends the campaign with its fault. Prints the table of docs/evidence/alarms.md.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from campaigns.releases.axis import START_S, CompensatedAxis, StepInput
from campaigns.releases.faults import ALL, arm, run

SEED = 37_000
FAULTS = 1000
BETWEEN_S = 65.0
SHORT_S, LONG_S = 0.5, 40.0


def campaign(seed: int, faults: int, folder: Path) -> tuple[CompensatedAxis, Counter[str], Counter[str]]:
    """Run a campaign; returns the axis, and of each kind the faults and those that released it."""
    rng = np.random.default_rng(seed)
    axis, drawn, released = CompensatedAxis(folder), Counter[str](), Counter[str]()
    for _ in range(faults):
        arm(axis, good := _good(axis, rng))
        for _ in range(1 + int(rng.exponential(BETWEEN_S) / 0.5)):
            axis.step(good := _good(axis, rng))
        if rng.random() < 0.5:
            axis.acknowledge()
        kind, before = ALL[rng.integers(len(ALL))], axis.tally.releases
        seconds = float(np.exp(rng.uniform(np.log(SHORT_S), np.log(LONG_S))))
        run(axis, kind, seconds, rng.random(), good)
        drawn[kind] += 1
        released[kind] += axis.tally.releases > before
    return axis, drawn, released


def _good(axis: CompensatedAxis, rng: np.random.Generator) -> StepInput:
    """A good estimate of an error that goes up and down by 40 µm within hours."""
    hours = (axis.time_s - START_S) / 3600.0
    return StepInput(
        error_um=20.0 + 20.0 * np.sin(hours) + rng.normal(0.0, 0.2), bound_um=rng.uniform(3.0, 9.0)
    )


def main() -> None:
    """Run it and print the table."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.releases", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--faults", type=int, default=FAULTS)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        axis, drawn, released = campaign(args.seed, args.faults, Path(folder))
        axis.close()
    tally = axis.tally
    print("| fault | drawn | released | with one alarm |\n|---|---|---|---|")
    for kind in ALL:
        print(f"| {kind} | {drawn[kind]} | {released[kind]} | {released[kind]} |")
    print(f"| all | {drawn.total()} | {released.total()} | {tally.alarms} |")
    hours = (axis.time_s - START_S) / 3600.0
    print(
        f"\n{tally.steps} steps, {hours:.1f} h; largest step of a written value "
        f"{tally.largest_step_um:.3f} um; releases without an alarm: {tally.releases - tally.alarms}"
    )


if __name__ == "__main__":
    main()
