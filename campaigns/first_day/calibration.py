"""`python -m campaigns.first_day.calibration`: is a day after a calibration ever predicted worse?

Each drawn machine is calibrated by 40 minutes of a stop-and-go shift with one fault, and then works another
shift from a cold start, which the calibration never saw. That shift is predicted from the heat laws with the
configuration before and after, and replayed with both. Errors are against readings and the true error.
Frozen before machines 201 to 224 were drawn: no written calibration may make the prediction of the further
shift's readings worse by more than 5 %.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

import observer
from campaigns.first_day.configuration import positions_m, write_configuration
from campaigns.resumable import go_on, read_rows
from observer import Machine
from observer.frames import FloatArray
from tests.truth.first_day.log import FORMATS, Shift, shift_of
from tests.truth.first_day.machine import FirstDayMachine, draw_machine
from tests.truth.first_day.thermal import error_um

JUDGED = range(201, 225)
HOURS, ROWS_A_SECOND, ANOTHER_SHIFT = 2.0 / 3.0, 10, 10_000
MOST_WORSE = 1.05
SENSORS = ("nut_body_degC", "left_housing_degC", "right_housing_degC")
FAULTS = ("none", "position", "stuck", "loose", "film", "short")


def with_fault(fault: str, log: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the columns of a log with one of `FAULTS`, which begins at 40 % of it.

    The position jumps by 60 mm for four minutes; a sensor keeps its value; one falls half of its way back to
    the air's temperature; or only the first twelve minutes were logged.
    """
    columns = {name: column.copy() for name, column in log.items()}
    time_s = columns["time_s"]
    late = time_s >= 0.4 * time_s[-1]
    if fault == "position":
        columns["nut_position_m"][late & (time_s < 0.4 * time_s[-1] + 240.0)] += 0.06
    elif fault == "stuck":
        nut_degC = columns["nut_body_degC"]
        last_degC = nut_degC[~late & np.isfinite(nut_degC)][-1]
        columns["nut_body_degC"] = np.where(late & np.isfinite(nut_degC), last_degC, nut_degC)
    elif fault == "loose":
        rise_K = columns["nut_body_degC"] - columns["ambient_degC"]
        columns["nut_body_degC"][late] -= np.round(0.5 * rise_K[late], 1)
    elif fault == "short":
        columns = {name: column[time_s <= 720.0] for name, column in columns.items()}
    return columns


def configured(fault: str, machine: FirstDayMachine, folder: Path) -> Machine:
    """Return the machine as `observer init` configures it; three times the film is one of the faults."""
    path = folder / "config.toml"
    write_configuration(path, machine)
    text = path.read_text(encoding="utf-8")
    if fault == "film":
        text = text.replace("convection_W_m2K = 15.0", "convection_W_m2K = 45.0")
    return Machine.of_text(text)


def columns_of(shift: Shift) -> dict[str, FloatArray]:
    """Return a shift's log by columns."""
    return {"time_s": shift.time_s, **dict(zip(FORMATS, shift.readings.T, strict=True))}


@dataclasses.dataclass(frozen=True)
class Further:
    """A shift that no calibration saw: its log, a row a second, and its true error (k,) at the far end."""

    log: dict[str, FloatArray]
    error_um: FloatArray
    far: str

    @classmethod
    def of(cls, machine: FirstDayMachine) -> Further:
        """Simulate another shift of a machine."""
        other = dataclasses.replace(machine, number=machine.number + ANOTHER_SHIFT)
        shift = shift_of(other, HOURS)
        log = {name: column[::ROWS_A_SECOND] for name, column in columns_of(shift).items()}
        place_m = positions_m(machine)[[-1 if machine.nameplate.fixed == "left" else 0]]
        zero_degC = float(np.round(shift.readings[0, -1], 1))
        true_um = error_um(machine, shift.screw_degC, place_m, zero_degC)[: len(log["time_s"]), 0]
        return cls(log, true_um, f"error_{1000.0 * place_m[0]:.10g}_um")

    def errors(self, product: Machine) -> tuple[float, float, float]:
        """Return the rms error of a prediction, K of readings and µm of growth, and of a replay, µm."""
        predicted, replayed = product.simulate(self.log), product.replay(self.log)
        readings_K = np.column_stack([predicted[name] - self.log[name] for name in SENSORS])
        ahead_um, now_um = (run[self.far] - self.error_um for run in (predicted, replayed))
        return _rms(readings_K), _rms(ahead_um), _rms(now_um)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def row_of(task: tuple[int, str]) -> list[dict[str, str]]:
    """Calibrate a machine by a log with a fault, and judge it by a further shift; return its row."""
    number, fault = task
    machine = draw_machine(number)
    log = with_fault(fault, columns_of(shift_of(machine, HOURS)))
    with tempfile.TemporaryDirectory() as folder:
        product = configured(fault, machine, Path(folder))
    begun, written, after, reason = time.process_time(), False, product, ""
    try:
        result = product.calibrate(log)
        written, after = result.kept is None, result.machine
        reason = result.kept or ""
    except observer.LogError as error:
        reason = str(error)
    seconds = time.process_time() - begun
    further = Further.of(machine)
    figures = (*further.errors(product), *(further.errors(after) if written else further.errors(product)))
    names = ("before_K", "before_um", "before_replay_um", "after_K", "after_um", "after_replay_um")
    row = {"machine": str(number), "fault": fault, "written": str(int(written)), "cpu_s": f"{seconds:.1f}"}
    return [row | {k: f"{v:.4g}" for k, v in zip(names, figures, strict=True)} | {"reason": reason}]


def summary(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the share of calibrations that made something worse, and by how much, by fault."""
    lines = [f"{'fault':10} machines written | worse, largest and median factor of K, µm and replayed µm"]
    for fault in (*FAULTS, "all"):
        chosen = [row for row in rows if fault in (row["fault"], "all")]
        written = [row for row in chosen if row["written"] == "1"]
        cells = []
        for name in ("K", "um", "replay_um"):
            pairs = [(float(r[f"after_{name}"]), float(r[f"before_{name}"])) for r in written]
            ratio = np.array([after / before for after, before in pairs] or [np.nan])
            cells.append(f"{np.sum(ratio > MOST_WORSE)} {np.max(ratio):.2f} {np.median(ratio):.2f}")
        lines.append(f"{fault:10} {len(chosen):8} {len(written):7} | " + " | ".join(cells))
    return "\n".join(lines)


def main() -> None:
    """Run what is missing and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--first", type=int, default=JUDGED[0])
    parser.add_argument("--machines", type=int, default=len(JUDGED))
    parser.add_argument("-o", "--output", type=Path, default=Path("build/first-day/calibration.csv"))
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    done = {(row["machine"], row["fault"]) for row in read_rows(options.output)}
    tasks = [
        (number, FAULTS[number % len(FAULTS)])
        for number in range(options.first, options.first + options.machines)
        if (str(number), FAULTS[number % len(FAULTS)]) not in done
    ]
    go_on(tasks, functools.partial(row_of), options.output, Console(), options.jobs)
    print(summary(read_rows(options.output)))


if __name__ == "__main__":
    main()
