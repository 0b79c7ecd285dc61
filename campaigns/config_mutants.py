"""Put many wrong configurations to the check, and print what it refused: `make config-mutants`."""

from __future__ import annotations

import argparse
import collections
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

from tests.hostile.mutants import mutants, verdict


def main() -> int:
    """Return how many mutants had no proper answer."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.config_mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    warnings.simplefilter("error")
    outcomes: collections.Counter[str] = collections.Counter()
    slowest = (0.0, "")
    with tempfile.TemporaryDirectory() as folder:
        for mutant in mutants(args.count, args.seed):
            start_s = time.process_time()
            try:
                outcomes["accepted" if verdict(mutant, Path(folder)) == "accepted" else "refused"] += 1
            except Exception:  # noqa: BLE001 (whatever comes in place of an answer is what is looked for)
                outcomes["failed"] += 1
                print(f"{mutant.label}\n{traceback.format_exc(limit=-3)}", flush=True)
            slowest = max(slowest, (time.process_time() - start_s, mutant.label))
    counts = ", ".join(f"{n} {outcome}" for outcome, n in sorted(outcomes.items()))
    print(f"{args.count} mutants: {counts}; the slowest: {slowest[0]:.1f} s of processor time, {slowest[1]}")
    return outcomes["failed"]


if __name__ == "__main__":
    sys.exit(min(main(), 1))
