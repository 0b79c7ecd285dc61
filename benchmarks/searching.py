"""The whole search for a missing effect on three logs: reading, search, proof, report, files."""

from __future__ import annotations

import gzip
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.table import Result
from benchmarks.timing import medians_s, shown
from observer import discover

RIG = Path(__file__).parents[1] / "tests" / "data" / "rig"
CASE, RUNS, ROWS, GOAL_S = "end_conduction-0.1", "abc", 15_000, 5.0


def results() -> list[Result]:
    """An outside code's rig with a loss at one end, each log cut to its first rows."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        logs = [_cut(RIG / CASE / f"run_{run}.csv.gz", folder) for run in RUNS]

        def search() -> str:
            found = discover(RIG / "config.toml", logs).write(folder / "found")
            return " ".join([found["verdict"], *(e["kind"] for e in found["effects"])])

        seconds = medians_s({"search": search}, repetitions=3)["search"]
        said = search()
    return [
        Result(
            f"search for a missing effect, {len(RUNS)} logs of {ROWS:,} rows",
            shown(seconds),
            said,
            goal=f"≤ {GOAL_S:g} s",
            met=seconds <= GOAL_S,
        )
    ]


def _cut(path: Path, folder: Path) -> Path:
    """The first rows of a log in another folder."""
    short = folder / path.name.removesuffix(".gz")
    lines = gzip.decompress(path.read_bytes()).splitlines(keepends=True)
    short.write_bytes(b"".join(lines[: ROWS + 1]))
    return short
