"""The heat history of a whole log: its inputs through the live path, results as files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import LogError
from observer.estimate.replay import heat_columns
from observer.files.logs import Log
from observer.files.results import write_json
from observer.files.writer import TableWriter
from observer.frames import FloatArray, FrameBlock, Inputs, Layout
from observer.history.history import HeatHistory
from observer.model.drive import Drive


def inputs_of(log: Iterable[FrameBlock], drive: Drive) -> list[Inputs]:
    """Return what drives the plant over the frames of a log, by the path that a live reading takes."""
    state, blocks = drive.initial(), []
    for frames in log:
        state, inputs = drive.run(state, frames)
        blocks.append(inputs)
    return blocks


def write_history(
    output: Path,
    layout: Layout,
    history: HeatHistory,
    log: Log,
    more: Mapping[str, Any],
    suffix: str = ".csv",
) -> dict[str, Any]:
    """Write `heat` + suffix and `summary.json` into `output`; return the content of the latter.

    Raises `LogError` where the log holds nothing to learn a heat from.
    """
    if not np.isfinite(history.heat_W).any():
        raise LogError(
            f"{log.path}: no sensor has a value while all inputs are known, so no heat can be told; check "
            "the sensors' channels"
        )
    with TableWriter(output / f"heat{suffix}") as writer:
        writer.write(heat_columns(layout, history))
    names = layout.sources
    summary = {
        "log": log.path.name,
        "rows": len(history),
        "duration_s": float(history.time_s[-1] - history.time_s[0]),
        "heat_mean_W": _by_name(names, history.heat_W),
        "heat_sigma_mean_W": _by_name(names, history.heat_sigma_W),
        "heat_peak_W": {
            name: float(np.nanmax(heat)) for name, heat in zip(names, history.heat_W.T, strict=True)
        },
        "residual_rms_K": {
            name: None if mean is None else mean**0.5
            for name, mean in _by_name(layout.sensors, history.residual_K**2).items()
        },
        **history.details,
        "warnings": list(history.warnings),
        **more,
    }
    write_json(output / "summary.json", summary)
    return summary


def _by_name(names: tuple[str, ...], values: FloatArray) -> dict[str, float | None]:
    """The mean of each column (K, n), None where nothing is known."""
    known = np.isfinite(values)
    return {
        name: float(column[here].mean()) if here.any() else None
        for name, column, here in zip(names, values.T, known.T, strict=True)
    }
