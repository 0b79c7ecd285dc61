"""Calibrate on the first half of a probe's run, predict the second: `python probe_drift.py RUN.json …`.

A run is lines of JSON as the probe benchmark of grumat/voron-trident-250_config writes them, also compressed:
temperatures (`ts`, `btemp`, `atherms`, `etemp`), and between them heights (`ts`, `z` in mm).
"""

from __future__ import annotations

import csv
import gzip
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import observer

CONFIG = Path(__file__).with_name("probe-drift.toml")
ROW_S = 10.0
CHANNELS = ("time_s", "start_degC", "probe_um", "bed_K", "chamber_K", "extruder_K")


class Drift(NamedTuple):
    """A run in rows of ten seconds, (n,): the probe, what is predicted of it and the σ of that, µm; the probe
    is known to the prediction in the rows of the first half only.
    """

    time_s: Any
    probe_um: Any
    predicted_um: Any
    sigma_um: Any

    @property
    def second(self) -> Any:
        """Which rows (n,) belong to the second half, and have a value."""
        return (self.time_s > 0.5 * self.time_s[-1]) & np.isfinite(self.probe_um)


def rows_of(path: Path) -> Any:
    """The rows (n, 6) of a run, in the order of `CHANNELS`; temperatures are rises above the start."""
    opened = gzip.open if path.suffix == ".gz" else open
    with opened(path, "rt", encoding="utf-8") as lines:
        said = [json.loads(line) for line in lines if line.strip()]
    heights = np.array([(one["ts"], 1e3 * one["z"]) for one in said if "z" in one])
    warm = np.array(
        [(one["ts"], one["btemp"], one["atherms"][0]["temp"], one["etemp"]) for one in said if "btemp" in one]
    )
    begin_s = warm[0, 0]
    at_s = np.arange(0.0, max(warm[-1, 0], heights[-1, 0]) - begin_s, ROW_S)
    row = np.rint((heights[:, 0] - begin_s) / ROW_S).astype(int)
    probe_um = [heights[row == k, 1].mean() if (row == k).any() else np.nan for k in range(len(at_s))]
    rises_K = [np.interp(at_s, warm[:, 0] - begin_s, warm[:, k] - warm[0, k]) for k in (1, 2, 3)]
    return np.column_stack([at_s, np.zeros_like(at_s), probe_um, *rises_K])


def drift(path: Path) -> Drift:
    """Replay a run whose probe falls silent half-way."""
    rows = rows_of(path)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "run.csv")
        with log.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(CHANNELS)
            for row in rows:
                is_read = np.isfinite(row[2]) and row[0] <= 0.5 * rows[-1, 0]
                writer.writerow([*row[:2], row[2] if is_read else "", *row[3:]])
        found = observer.load(CONFIG).replay(log)
    # it reads the rod's growth from where its zero is
    predicted_um = found["error_1000_um"] + found["learned_sensor.probe.zero_um"]
    sigma_um = np.hypot(found["error_1000_sigma_um"], 1.1)
    return Drift(rows[:, 0], rows[:, 2], predicted_um, sigma_um)


def main(paths: list[str]) -> None:
    """Say of each run how far its second half is from the prediction."""
    print("run                       off, rms   σ, mean   within 95 %   last value held, rms")
    for path in map(Path, paths):
        one = drift(path)
        second = one.second
        off_um, sigma_um = (one.probe_um - one.predicted_um)[second], one.sigma_um[second]
        held_um = one.probe_um[second] - one.probe_um[~second & np.isfinite(one.probe_um)][-1]
        within = float(np.mean(np.abs(off_um) <= 1.96 * sigma_um))
        rms_um, held_um = (float(np.sqrt(np.mean(each**2))) for each in (off_um, held_um))
        name = path.name.split(".")[0]
        print(f"{name:26}{rms_um:5.1f} µm {sigma_um.mean():6.1f} µm {within:12.0%} {held_um:17.1f} µm")


if __name__ == "__main__":
    main(sys.argv[1:])
