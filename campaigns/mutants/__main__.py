"""Change the code in small ways and see whether the tests nearest to it notice: `make mutants`."""

from __future__ import annotations

import argparse
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from queue import Queue

from campaigns.mutants import record
from campaigns.mutants.mutate import Mutant, change, mutants_of, mutated, sample
from campaigns.mutants.nearest import NEAREST, ROOT
from campaigns.mutants.trial import Tree
from campaigns.runs import note_run

BUILD = ROOT / "build" / "mutants"
FIRST_LIMIT_S = 900.0


def main() -> int:
    """Return how many survivors have no reason, and modules no tests that pass."""
    parser = argparse.ArgumentParser(prog="python -m campaigns.mutants", description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="mutants of each module (40)")
    parser.add_argument("--all", action="store_true", help="all mutants of each module")
    parser.add_argument("--seed", type=int, default=1, help="which are drawn (1)")
    parser.add_argument("--only", nargs="+", default=list(NEAREST), metavar="MODULE", help="part of a path")
    parser.add_argument("--workers", type=int, default=2, help="copies of the tree at work (2)")
    parser.add_argument("--survivors", action="store_true", help="try again those that survived before")
    parser.add_argument("--afresh", action="store_true", help="forget what was tried before")
    parser.add_argument("--no-write", action="store_true", help="leave the documents as they are")
    parser.add_argument(
        "--page", action="store_true", help="only write the page again, after reasons were given"
    )
    options = parser.parse_args()
    if options.page:
        record.write(record.survivors(), record.counts())
        return 0
    modules = [m for m in NEAREST if any(part in m for part in options.only)]
    if not modules:
        parser.error(f"no module is named so; there are {' '.join(NEAREST)}")
    BUILD.mkdir(parents=True, exist_ok=True)
    if options.afresh:
        (BUILD / "results.jsonl").unlink(missing_ok=True)
    run = Run(options.workers, record.Results(BUILD / "results.jsonl"), again=options.survivors)
    found: list[record.Survivor] = []
    counted: list[record.Count] = []
    left_out: list[str] = []
    for module in modules:
        source = run.source(module)
        every = list(mutants_of(module, source))
        drawn = sample(every, len(every) if options.all else options.count, options.seed)
        alive = run.survivors(module, drawn)
        if alive is None:
            left_out.append(module)
            print(f"{module}: left out, since its nearest tests fail on the code as it is", flush=True)
            continue
        found += [
            record.Survivor(
                module, m.line, m.operator, change(source, mutated(source, m)), record.WITHOUT_REASON
            )
            for m in alive
        ]
        counted.append(record.Count(module, len(every), len(drawn), len(alive)))
        print(f"{module}: {len(drawn)} of {len(every)} tried, {len(alive)} survived", flush=True)
    run.close()
    tried = set(modules) - set(left_out)
    merged = record.merged(found, record.survivors(), tried)
    if not options.no_write:
        others = [c for c in record.counts() if c.module not in tried]
        record.write(merged, sorted(others + counted, key=lambda c: c.module))
        note_run(record.SUMMARY)
    without = [s for s in merged if s.reason == record.WITHOUT_REASON and s.module in tried]
    for s in without:
        print(f"{s.module}:{s.line}: {s.diff}")
    together = sum(c.tried for c in counted)
    share = 100 * len(found) / max(together, 1)
    print(f"{len(found)} of {together} survived, {share:.1f} %; {len(without)} without reason")
    return len(without) + len(left_out)


class Run:
    """Workers, each with its copy of the tree, and what is known already."""

    def __init__(self, workers: int, results: record.Results, *, again: bool) -> None:
        self._results, self._again = results, again
        self._trees: Queue[Tree] = Queue()
        for n in range(workers):
            tree = Tree(BUILD / f"worker-{n + 1}")
            self._trees.put(tree)
        self._sources = tree.root
        self._pool = ThreadPoolExecutor(workers)

    def source(self, module: str) -> str:
        """The module as it was when the run began, however long it takes."""
        return (self._sources / module).read_text(encoding="utf-8")

    def survivors(self, module: str, mutants: list[Mutant]) -> list[Mutant] | None:
        """Try the mutants that were not tried; return those that survive, None where the tests fail."""
        source = self.source(module)
        digest = f"{zlib.crc32(source.encode()):08x}"

        def key(m: Mutant) -> tuple[object, ...]:
            return m.module, digest, m.operator, m.occurrence

        done = (False,) if self._again else (False, True)
        waiting = [m for m in mutants if self._results.survived(*key(m)) not in done]
        if waiting:
            limit_s = self._limit_s(module)
            if limit_s is None:
                return None

            def trial(m: Mutant) -> bool:
                tree, made = self._trees.get(), mutated(source, m)
                try:
                    survived, _ = tree.passes_with(module, made, NEAREST[module], limit_s)
                finally:
                    self._trees.put(tree)
                self._results.add(*key(m), survived=survived)
                outcome = "survived" if survived else "killed"
                print(f"{outcome:8} {m.module}:{m.line}: {change(source, made)}", flush=True)
                return survived

            list(self._pool.map(trial, waiting))
        return [m for m in mutants if self._results.survived(*key(m))]

    def close(self) -> None:
        """End the workers."""
        self._pool.shutdown()
        while not self._trees.empty():
            self._trees.get().close()

    def _limit_s(self, module: str) -> float | None:
        """How long the tests of a mutant may take: some times as long as those of the code as it is."""
        trees = [self._trees.get() for _ in range(self._trees.qsize())]

        def untouched(tree: Tree) -> tuple[bool, float]:
            return tree.passes(NEAREST[module], FIRST_LIMIT_S)

        taken = list(self._pool.map(untouched, trees))
        for tree in trees:
            self._trees.put(tree)
        if not all(passed for passed, _ in taken):
            return None
        return 3.0 * max(seconds for _, seconds in taken) + 30.0


if __name__ == "__main__":
    sys.exit(min(main(), 1))
