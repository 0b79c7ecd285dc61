"""Coverage of the observers with fixed gains, with and without what they allow for, on rough machines.

`python -m campaigns.learning.fixed_gains [FIRST_SEED [MACHINES]]` prints a table of the machines it has run.
"""

from __future__ import annotations

import sys

import numpy as np

from campaigns.learning.trial import KNOWN
from tests.learning.cover import QUANTITIES, judged
from tests.learning.machines import Rough, config_of, day, draw

SEED, MACHINES = 12000, 16
KINDS = {"luenberger": 'kind = "luenberger"\n', "constant gain": 'engine = "constant"\n'}
TOLERANCES = {"known": KNOWN, "allowed": "[estimator]\n"}
UNITS = {"heats": "W", "nut": "W", "field": "K", "error": "µm"}

Found = dict[tuple[str, str, str], list[tuple[float, float, float]]]


def tried(seed: int, number: int, found: Found) -> None:
    """Put one machine's rms error, coverage and σ to those of the others."""
    one = day(draw(seed, number, Rough()), seed, number, "abc"[number % 3], warm=number % 2 == 1)
    for kind, line in KINDS.items():
        for name, more in TOLERANCES.items():
            for quantity, values in judged(config_of(more=more + line), one).items():
                found.setdefault((kind, name, quantity), []).append(values)


def table(found: Found) -> str:
    """A line for each kind and quantity: rms error, coverage and σ."""
    lines = [
        "| observer | quantity | rms error | 95 % intervals hold, known → allowed | on the worst machine | "
        "σ, known → allowed |",
        "|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        for quantity in QUANTITIES:
            known, allowed = (np.array(found[kind, name, quantity]) for name in TOLERANCES)
            unit = UNITS[quantity]
            lines.append(
                f"| {kind} | {quantity} | {np.sqrt(np.mean(allowed[:, 0] ** 2)):.2f} {unit} | "
                f"{100 * known[:, 1].mean():.0f} → {100 * allowed[:, 1].mean():.0f} % | "
                f"{100 * known[:, 1].min():.0f} → {100 * allowed[:, 1].min():.0f} % | "
                f"{known[:, 2].mean():.2f} → {allowed[:, 2].mean():.2f} {unit} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Run them one after the other."""
    given = [int(a) for a in sys.argv[1:]]
    seed, machines = (*given, *(SEED, MACHINES)[len(given) :])
    found: Found = {}
    for number in range(machines):
        tried(seed, number, found)
        sys.stderr.write(f"{number + 1} of {machines} machines\n")
    print(table(found))


if __name__ == "__main__":
    main()
