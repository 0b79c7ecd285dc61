"""The end of a run: `results.parquet` and `report.html` of everything in the folder."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from observer.fleet.journal import Row, rows_in
from observer.fleet.report import write_report

_FIRST = ("machine", "verb", "name", "logs", "config", "folder", "problem", "seconds")


def conclude(output: Path, rows: Sequence[Row]) -> list[Row]:
    """Write `results.parquet` and `report.html` of all that is done in a folder, by this run or others.

    Returns the rows of this run that failed, in their order, which are in both files too.
    """
    failures = sorted((row for row in rows if row["problem"] is not None), key=lambda row: str(row["folder"]))
    lost = {row["folder"] for row in failures}  # there may be results of an older log of that name
    folders = {_identity(row): row["folder"] for row in rows}
    there = [
        row
        for row in rows_in(output)
        if row["folder"] not in lost and folders.get(_identity(row), row["folder"]) == row["folder"]
    ]
    write_table(output / "results.parquet", [*there, *failures])
    write_report(output / "report.html", there, failures)
    return failures


def _identity(row: Row) -> tuple[str, ...]:
    """What was done, in whichever folder: logs may have changed places since, among others of their name."""
    return (row["machine"], row["verb"], *row["logs"])


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write the rows of a fleet, one for every job; the file is there whole or not at all.

    Numbers of several things get a column each, as `heat_mean_nut_W`; lists are JSON.
    """
    import pyarrow as pa
    from pyarrow import parquet

    flat = [flattened(row) for row in rows]
    names = dict.fromkeys(_FIRST) | dict.fromkeys(name for row in flat for name in row)
    columns = {name: [row.get(name) for row in flat] for name in names}
    table = pa.table({name: pa.array(cells, _type(name, cells)) for name, cells in columns.items()})
    part = path.with_name(f".{path.name}.part")
    try:
        parquet.write_table(table, part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _type(name: str, cells: Sequence[Any]) -> Any:
    import pyarrow as pa

    known = [cell for cell in cells if cell is not None]
    is_text = not known or any(isinstance(cell, str) for cell in known)
    return pa.string() if is_text and name != "seconds" else pa.float64()


def flattened(row: Row) -> dict[str, Any]:
    """Return a row as cells: texts and numbers."""
    found = row["found"]
    cells: dict[str, Any] = {key: row[key] for key in _FIRST}
    cells["logs"] = json.dumps(row["logs"])
    cells |= {key: float(found[key]) for key in ("rows", "duration_s", "good") if key in found}
    cells |= {key: found[key] for key in ("type", "verdict") if key in found}
    cells |= {f"heat_mean_{name}_W": heat_W for name, heat_W in found.get("heat_mean_W", {}).items()}
    cells |= {f"speed_mean_{name}_rpm": rpm for name, rpm in found.get("speed_mean_rpm", {}).items()}
    for key, fitted in found.get("calibrated", {}).items():
        low, high = fitted["ci95"]
        cells |= {key: fitted["value"], f"{key}_low": low, f"{key}_high": high}
    if "gap" in found:
        cells |= {f"gap_{key}": found["gap"][key] for key in ("before_rms_K", "after_rms_K")}
    lists = ("effects", "alternatives", "doubts", "not_told")
    cells |= {key: json.dumps(found[key]) for key in lists if key in found}
    return {key: None if isinstance(c, float) and not math.isfinite(c) else c for key, c in cells.items()}
