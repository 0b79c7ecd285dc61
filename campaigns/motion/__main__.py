"""Measure false and missed jumps and write them as CSV: `python -m campaigns.motion --days 30 --seed 1`."""

from __future__ import annotations

import argparse
import csv
import sys

import numpy as np

from campaigns.motion.measure import FAULTS, PERIODS_S, faulty_delay_s, healthy

DAY_S = 86400.0


def main() -> None:
    """Write a row per period of polling, and one per fault, period and load."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--faults", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options, write = parser.parse_args(), csv.writer(sys.stdout).writerow
    write(["case", "period_s", "computer", "number", "jumps_or_found", "disagreements_or_median_s"])
    for period_s in PERIODS_S:
        days = [healthy(period_s, DAY_S, options.seed + day) for day in range(options.days)]
        write(
            [
                "healthy",
                period_s,
                "drawn",
                sum(d[0] for d in days),
                sum(d[1] for d in days),
                sum(d[2] for d in days),
            ]
        )
        sys.stdout.flush()
        for samples, jumps, disagreements, polling in days:
            if jumps or disagreements:
                print("#", samples, jumps, disagreements, polling, file=sys.stderr)
    for name, size_m in FAULTS:
        for period_s in PERIODS_S:
            for loaded in (False, True):
                seeds = range(options.seed, options.seed + options.faults)
                delays_s = np.array([faulty_delay_s(name, size_m, period_s, loaded, s) for s in seeds])
                found = delays_s[np.isfinite(delays_s)]
                middle = round(float(np.median(found)), 2) if len(found) else ""
                write([name, period_s, "loaded" if loaded else "idle", len(delays_s), len(found), middle])
                sys.stdout.flush()


if __name__ == "__main__":
    main()
