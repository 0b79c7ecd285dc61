"""The end of a run: `results.parquet` and `report.html` of everything in the folder.

The page shows which effects each machine lacks, and which bearings run hot.
"""

from __future__ import annotations

import math
import re
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.files.folders import results_in
from observer.fleet.journal import Row, rows_in
from observer.process.terminal import readable_json
from observer.report.page import Html, document, paragraph, safe, section, table, tiles

NEAR = 0.2
"""Speeds within this fraction of each other are compared; beyond it friction depends on speed."""
LEAST_OTHERS = 3
HOT_SHARE = 0.2
HOT_DEVIATIONS = 3.0
LEAST_GOOD = 0.5
"""Smallest fraction of good estimates at which a log's mean heats count as reliable."""
_NORMAL_MAD = 1.4826  # of a normal distribution: its standard deviation over its median absolute deviation


@dataclass(frozen=True, slots=True)
class MeanHeat:
    """The mean heat of one source in one log, at a mean speed, of a machine of some type.

    Attributes:
        machine: The machine's name.
        type: The screw's size in words; only machines of one type are compared.
        source: The heat source's name.
        speed_rpm: The mean speed over the log, in rpm.
        heat_W: The mean heat over the log, in W.
        good: The fraction of good estimates in the log, NaN without a replay.
    """

    machine: str
    type: str
    source: str
    speed_rpm: float
    heat_W: float
    good: float = math.nan


@dataclass(frozen=True, slots=True)
class ComparedHeat(MeanHeat):
    """The heat of a machine's source, compared with that of similar machines.

    Attributes:
        usual_W: The median of the others at the same speed, in W; None if fewer than three other machines run
            at about that speed.
        others: How many other machines were compared.
        hot: Whether the heat exceeds the usual one beyond the spread of the fleet.
    """

    usual_W: float | None = None
    others: int = 0
    hot: bool = False

    @property
    def doubtful(self) -> bool:
        """Whether so few of the underlying estimates were good that the heat is unreliable.

        NaN, which means that no replay was made, does not make it doubtful.
        """
        return self.good < LEAST_GOOD


def compare_with_fleet(heats: Sequence[MeanHeat]) -> list[ComparedHeat]:
    """Compare each machine's sources with the median of other machines of its type, at about its speed.

    A machine counts once for each source, by the medians of its logs. Heats are compared per rpm, which
    removes the remaining difference in speed. A source is hot if it exceeds the median by a fifth and by
    three standard deviations. The deviation is estimated from the median absolute deviation.

    Args:
        heats: One for each source and log.

    Returns:
        One for each type, source and machine, in that order.
    """
    by_source: dict[tuple[str, str, str], list[MeanHeat]] = {}
    for heat in heats:
        by_source.setdefault((heat.type, heat.source, heat.machine), []).append(heat)
    points = [
        MeanHeat(
            machine, kind, source, _median(h.speed_rpm for h in source_heats),
            _median(h.heat_W for h in source_heats),
            min((h.good for h in source_heats if not math.isnan(h.good)), default=math.nan),
        )
        for (kind, source, machine), source_heats in sorted(by_source.items())
    ]  # fmt: skip
    return [_compared(point, points) for point in points]


def _median(values: Iterable[float]) -> float:
    return float(np.median(list(values)))


def _compared(point: MeanHeat, points: Sequence[MeanHeat]) -> ComparedHeat:
    """Return the heat of one source with the median of the other machines."""
    others = [
        other.heat_W / other.speed_rpm
        for other in points
        if (other.type, other.source) == (point.type, point.source)
        and other.machine != point.machine
        and other.speed_rpm > 0
        and abs(other.speed_rpm - point.speed_rpm) <= NEAR * max(other.speed_rpm, point.speed_rpm)
    ]
    usual_W, hot = None, False
    if len(others) >= LEAST_OTHERS:
        median = float(np.median(others))
        spread = _NORMAL_MAD * float(np.median(np.abs(np.array(others) - median)))
        usual_W = median * point.speed_rpm
        allowed_W = max(HOT_SHARE * abs(usual_W), HOT_DEVIATIONS * spread * point.speed_rpm)
        hot = point.heat_W - usual_W > allowed_W
    return ComparedHeat(**asdict(point), usual_W=usual_W, others=len(others), hot=hot)


MOST_LINES = 200
_DASH = "–"
_NO_EFFECT = "nothing"
_DOUBTS = {
    "unknown": "something the library does not have",
    "not_identifiable": "something that its logs cannot identify",
}
_FIRST = ("machine", "verb", "name", "logs", "config", "folder", "problem", "seconds")


def conclude(output: Path, rows: Sequence[Row]) -> list[Row]:
    """Write `results.parquet` and `report.html` of all finished jobs in a folder, of this run and others.

    Both files appear together, whole or not at all.

    Args:
        output: The folder of results.
        rows: The rows of this run, failed ones too.

    Returns:
        The failed rows of this run, by folder; both files contain them too.

    Raises:
        UserError: If the files cannot be written.
    """
    failures = sorted((row for row in rows if row["problem"] is not None), key=lambda row: str(row["folder"]))
    failed_folders = {row["folder"] for row in failures}  # there may be results of an older log of that name
    folders = {_identity(row): row["folder"] for row in rows}
    finished = [
        row
        for row in rows_in(output)
        if row["folder"] not in failed_folders and folders.get(_identity(row), row["folder"]) == row["folder"]
    ]
    with results_in(output) as part:
        write_table(part / "results.parquet", [*finished, *failures])
        (part / "report.html").write_text(page(finished, failures), encoding="utf-8")
    return failures


def _identity(row: Row) -> tuple[str, ...]:
    """Return machine, verb and logs of a row: the same work, even if its folder has changed."""
    return (row["machine"], row["verb"], *row["logs"])


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write the rows of a fleet, one for every job, as Parquet.

    Numbers of several sources get a column each, such as `heat_mean_nut_W`; lists are JSON. A cell is empty
    where a verb has no such figure.

    Args:
        path: The file, which is replaced.
        rows: Finished and failed jobs of any verb.

    Raises:
        OSError: If the file cannot be written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    flat = [flattened(row) for row in rows]
    names = dict.fromkeys(_FIRST) | dict.fromkeys(name for row in flat for name in row)
    columns = {name: [row.get(name) for row in flat] for name in names}
    table = pa.table({name: pa.array(cells, _type(name, cells)) for name, cells in columns.items()})
    parquet.write_table(table, path)


def _type(name: str, cells: Sequence[Any]) -> Any:
    import pyarrow as pa

    filled = [cell for cell in cells if cell is not None]
    is_text = not filled or any(isinstance(cell, str) for cell in filled)
    return pa.string() if is_text and name != "seconds" else pa.float64()


def flattened(row: Row) -> dict[str, Any]:
    """Return a row as cells of text and numbers, by column.

    Units end the columns' names. A fitted parameter has three columns: value, and the limits `_low` and
    `_high` of its 95 % interval. Numbers that are not finite become None.
    """
    result = row["found"]
    cells: dict[str, Any] = {key: row[key] for key in _FIRST}
    cells["logs"] = readable_json(row["logs"])
    cells |= {key: float(result[key]) for key in ("rows", "duration_s", "good") if key in result}
    cells |= {key: result[key] for key in ("type", "verdict") if key in result}
    cells |= {f"heat_mean_{name}_W": heat_W for name, heat_W in result.get("heat_mean_W", {}).items()}
    cells |= {f"speed_mean_{name}_rpm": rpm for name, rpm in result.get("speed_mean_rpm", {}).items()}
    for key, fitted in result.get("calibrated", {}).items():
        low, high = fitted["ci95"]
        cells |= {key: fitted["value"], f"{key}_low": low, f"{key}_high": high}
    if "gap" in result:
        cells |= {f"gap_{key}": result["gap"][key] for key in ("before_rms_K", "after_rms_K")}
    lists = ("effects", "alternatives", "doubts", "not_told")
    cells |= {key: readable_json(result[key]) for key in lists if key in result}
    return {key: None if isinstance(c, float) and not math.isfinite(c) else c for key, c in cells.items()}


def page(rows: Sequence[Row], failures: Sequence[Row]) -> str:
    """Return the report as one HTML file that needs no other.

    It shows the missing effects with their machines, the sources that run hot, failures, doubts about logs,
    and each machine. Long lists are cut after `MOST_LINES`.

    Args:
        rows: Finished jobs of any verb.
        failures: Jobs that could not be done, each with its problem.
    """
    comparisons = compare_with_fleet(heats_of(rows))
    hot = [b for b in comparisons if b.hot]
    searches = [row for row in rows if row["verb"] == "discover"]
    machines = sorted({row["machine"] for row in [*rows, *failures]}, key=_natural_order)
    head = tiles(
        [
            ("machines", str(len(machines))),
            ("logs done", str(len({log for row in rows for log in row["logs"]}))),
            ("could not be done", str(len(failures))),
            (
                "lack a named effect",
                str(sum(bool(row["found"]["effects"]) for row in searches)) if searches else _DASH,
            ),
            ("run hot", str(len({b.machine for b in hot})) if comparisons else _DASH),
        ]
    )
    parts = [
        Html(f"<header><h1>{len(machines)} machines side by side</h1></header>"),
        head,
        _effects(searches),
        _hot(comparisons),
        _failures(failures),
        _doubted(rows),
        _machines(machines, rows, comparisons),
    ]
    return document("Fleet", [part for part in parts if part])


def _natural_order(name: str) -> list[tuple[int, str]]:
    """Return a sort key for natural order: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def heats_of(rows: Sequence[Row]) -> list[MeanHeat]:
    """Return the heats of all sources with a speed; the heats of `identify` replace those of a replay.

    The fraction of good estimates always comes from the replay of the same logs.
    """
    best, good = dict[tuple[str, ...], Row](), dict[tuple[str, ...], float]()
    for row in rows:
        if row["verb"] in ("replay", "identify"):
            key = (row["machine"], *row["logs"])
            good[key] = row["found"].get("good", good.get(key, math.nan))
            if key not in best or row["verb"] == "identify":
                best[key] = row
    return [
        MeanHeat(
            row["machine"],
            row["found"]["type"],
            source,
            row["found"]["speed_mean_rpm"][source],
            heat_W,
            good[key],
        )
        for key, row in best.items()
        for source, heat_W in row["found"]["heat_mean_W"].items()
        if heat_W is not None and source in row["found"]["speed_mean_rpm"]
    ]


def _machines(machines: Sequence[str], rows: Sequence[Row], comparisons: Sequence[ComparedHeat]) -> Html:
    """Return the section with a row for each machine: screw, number of logs, missing effect, and heats."""
    types = {row["machine"]: row["found"]["type"] for row in rows}
    logs = Counter(machine for machine, _ in {(row["machine"], log) for row in rows for log in row["logs"]})
    lacks = {row["machine"]: _lacks(row) for row in rows if row["verb"] == "discover"}
    heats: dict[str, list[Html]] = {}
    for b in comparisons:
        heats.setdefault(b.machine, []).append(_heat(b))
    lines = [
        [
            machine,
            _unbroken(types.get(machine, _DASH)),
            str(logs[machine]),
            lacks.get(machine, _DASH),
            Html("<br>".join(heats.get(machine, [_DASH]))),
        ]
        for machine in machines
    ]
    heads = ("machine", "screw", "logs", "lacks", "heat, beside the usual at its speed")
    return section("Each machine", table(heads, lines, (2,), stacked=True))


def _heat(b: ComparedHeat) -> Html:
    usual = "no like to compare" if b.usual_W is None else f"usual {b.usual_W:.1f} W"
    text = f"{b.source} {b.heat_W:.1f} W ({usual})"
    text_or_hot = Html(f"<b>{safe(text)}, hot</b>") if b.hot else Html(safe(text))
    return text_or_hot if math.isnan(b.good) else _greyed(Html(f"{text_or_hot}, {_good(b)} good"), b)


def _good(b: ComparedHeat) -> str:
    """Return the fraction of good estimates of a heat as text, rounded down: 100 % means all."""
    return _DASH if math.isnan(b.good) else f"{math.floor(100 * b.good)}\N{NO-BREAK SPACE}%"


def _greyed(text: str, b: ComparedHeat) -> Html:
    """Return a figure, grey if hardly any of its estimates was good."""
    return Html(f'<span class="doubtful">{safe(text)}</span>') if b.doubtful else safe(text)


def _lacks(row: Row) -> str:
    result = row["found"]
    if result["effects"]:
        return ", ".join(_named(effect["kind"], effect["target"]) for effect in result["effects"])
    if result["verdict"] == "ambiguous":
        return " or ".join(" with ".join(alternative) for alternative in result["alternatives"])
    return _DOUBTS.get(result["verdict"], _NO_EFFECT)


def _named(kind: str, target: str | None) -> str:
    return kind if target is None else f"{kind} ({target})"


def _effects(searches: Sequence[Row]) -> Html:
    """Return the section of missing effects with their machines, the most frequent first."""
    lacking: dict[str, list[Row]] = {}
    for row in searches:
        lacking.setdefault(_lacks(row), []).append(row)
    lines = [
        [
            effects,
            str(len(searches_lacking)),
            _names([row["machine"] for row in searches_lacking]),
            _gap(searches_lacking),
        ]
        for effects, searches_lacking in sorted(
            lacking.items(), key=lambda item: (item[0] == _NO_EFFECT, -len(item[1]), item[0])
        )
    ]
    heads = ("lacks", "machines", "which", "median gap, K rms")
    return section("What they lack", table(heads, lines, (1,), stacked=True))


def _names(machines: Sequence[str]) -> Html:
    """Return names in natural order, none broken at its hyphen."""
    return Html(
        ", ".join(f'<span class="whole">{safe(name)}</span>' for name in sorted(machines, key=_natural_order))
    )


def _unbroken(text: str) -> str:
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _gap(searches: Sequence[Row]) -> str:
    """Return the gaps of the models before and after, for the median machine."""
    gaps = [row["found"]["gap"] for row in searches]
    before, after = (statistics.median(gap[key] for gap in gaps) for key in ("before_rms_K", "after_rms_K"))
    return _unbroken(f"{before:.2g} → {after:.2g}")


def _hot(comparisons: Sequence[ComparedHeat]) -> Html:
    """Return the section of sources that run hot, the hottest first."""
    lines = [
        [
            b.machine,
            b.source,
            f"{b.speed_rpm:.0f}",
            _greyed(f"{b.heat_W:.1f}", b),
            f"{b.usual_W:.1f}",
            _greyed(f"{b.heat_W / b.usual_W:.2f}", b) if b.usual_W else _DASH,
            str(b.others),
            _greyed(_good(b), b),
        ]
        for b in sorted(comparisons, key=lambda b: b.heat_W - (b.usual_W or 0.0), reverse=True)
        if b.hot and b.usual_W is not None
    ]
    if not comparisons:
        return Html("")
    heads = ("machine", "source", "speed, rpm", "heat, W", "usual, W", "times the usual", "others", "good")
    note = (
        "The usual is the median of at least three other machines with the same screw whose mean speed is "
        "within 20 %, per rpm. Hot is a source that exceeds it by a fifth, and by three of the fleet's "
        "standard deviations. Good is the share of the replay's estimates that were good, of several logs "
        f"the least; a heat with less than {LEAST_GOOD:.0%} is grey."
    )
    footer = paragraph("None.") if not lines else Html("")
    return section(
        "Running hot", paragraph(note, "note"), table(heads, lines, (2, 3, 4, 5, 6, 7), stacked=True), footer
    )


def _failures(failures: Sequence[Row]) -> Html:
    lines = [[row["machine"], _names([row["name"]]), row["problem"], row["verb"]] for row in failures]
    return _bounded("Could not be done", ("machine", "log", "why", "verb"), lines)


def _doubted(rows: Sequence[Row]) -> Html:
    """Return the section of doubts about logs that the commands could use."""
    doubts = dict.fromkeys(
        (row["machine"], doubt) for row in rows for doubt in row["found"].get("doubts", ())
    )
    lines = [[machine, doubt] for machine, doubt in sorted(doubts, key=lambda line: _natural_order(line[0]))]
    return _bounded("Doubted", ("machine", "what"), lines)


def _bounded(title: str, heads: Sequence[str], lines: Sequence[Sequence[str]]) -> Html:
    """A section with the first of many lines."""
    hidden_lines = len(lines) - MOST_LINES
    footer = paragraph(f"… and {hidden_lines} more, in results.parquet.") if hidden_lines > 0 else Html("")
    return section(title, table(heads, lines[:MOST_LINES], stacked=True), footer)
