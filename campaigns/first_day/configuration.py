"""The configuration that `observer init` writes for a drawn machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomlkit

from observer.frames import FloatArray
from observer.installation.first_configuration import write_new
from tests.truth.first_day.machine import FirstDayMachine

GRID = 21
"""Places on the screw, from end to end, at which field and thermal error are reported."""


def positions_m(machine: FirstDayMachine) -> FloatArray:
    """Return where the product reports field and thermal error, (21,)."""
    return np.linspace(0.0, machine.nameplate.length_m, GRID)


def answers_of(machine: FirstDayMachine) -> dict[str, str]:
    """Return what a user of the machine answers `observer init`, by the names of its questions."""
    nameplate = machine.nameplate
    low_m, high_m = nameplate.stroke_m
    return {
        "machine": f"first-day-{machine.number}",
        "axis": "z" if nameplate.vertical else "x",
        "screw": nameplate.screw,
        "length_m": f"{1000.0 * nameplate.length_m:g} mm",
        "stroke_m": f"{1000.0 * low_m:g} {1000.0 * high_m:g} mm",
        "mounting": nameplate.mounting,
        "fixed_end": nameplate.fixed,
        "housings": "all",
        "nut_kg": f"{nameplate.nut_kg:g}",
        "module": "wago_750_458",
        "module_at": "192.168.0.20",
        "ambient": "input",
        "control": "modbus",
        "control_at": "192.168.0.21",
        "counts_per_m": "1000000",
        "position_register": "0",
        "speed_register": "2",
    }


def write_configuration(path: Path, machine: FirstDayMachine) -> None:
    """Write what `observer init` writes, with the compensation enabled so that it can be armed."""
    path.unlink(missing_ok=True)
    write_new(path, answers_of(machine), None)
    document = tomlkit.parse(path.read_text(encoding="utf-8"))
    compensation = document.setdefault("compensation", tomlkit.table())
    compensation.update({"enabled": True, "controller_compensates": False, "position_feedback": "motor"})
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
