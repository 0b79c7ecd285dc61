"""The reduced plant as matrices with names and units, for numpy, MATLAB and any reader of JSON."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from observer.config import Config
from observer.export.data import Exportable, unit_of
from observer.files.folders import write_json
from observer.model.generator import generator, known_columns, output_names


def plant_matrices(config: Config) -> dict[str, Any]:
    """Return dx/dt = A x + B q + E z, y = C x + F z, and, inputs held, x⁺ = Ad x + Bd q + Ed z.

    Heats q in W, known inputs z in °C and K, outputs y as in `estimates.csv`, with the names of all; a nut
    that moves is spread over its stroke. Raises `ConfigError` for a plant that varies otherwise.
    """
    own = Exportable(config)
    plant, step = own.plant, own.step
    beside = len(plant.decay_1_s) - plant.lag_slice.stop
    outputs = output_names(plant)
    inputs = [*(f"heat_{name}_W" for name in plant.source_names), *known_columns(plant)]
    states = [*(f"mode {n}" for n in plant.mode_index), *(f"lag {name}" for name in plant.source_names)]
    states += [f"beside {n + 1}" for n in range(beside)]
    if plant.basis is not None:
        states = [f"own mode {n + 1}" for n in range(len(states))]
    return {
        "machine": config.machine.name, "axis": config.machine.axis, "configuration": config.digest,
        "version": version("ballscrew-observer"), "period_s": own.period_s,
        "states": states, "inputs": inputs, "input_units": list(map(unit_of, inputs)),
        "outputs": outputs, "output_units": list(map(unit_of, outputs)),
        "A": generator(plant), "B": plant.B, "E": plant.E, "C": plant.rows.C, "F": plant.rows.F,
        "Ad": np.diag(step.decay), "Bd": step.hold[:, None] * plant.B, "Ed": step.hold[:, None] * plant.E,
    }  # fmt: skip


def write_npz(found: dict[str, Any], folder: Path) -> str:
    """Write `plant.npz`, texts as arrays of them; return its name."""
    np.savez(folder / "plant.npz", allow_pickle=False, **{k: np.asarray(v) for k, v in found.items()})
    return "plant.npz"


def write_mat(found: dict[str, Any], folder: Path) -> str:
    """Write `plant.mat`, lists of texts as cell arrays; return its name."""
    from scipy.io import savemat  # noqa: PLC0415  (start-up: only this format needs it)

    cells = {k: np.array(v, dtype=object) if isinstance(v, list) else v for k, v in found.items()}
    savemat(folder / "plant.mat", cells, oned_as="column")
    return "plant.mat"


def write_plant_json(found: dict[str, Any], folder: Path) -> str:
    """Write `plant.json`, matrices as lists of rows; return its name."""
    write_json(folder / "plant.json", {k: np.asarray(v).tolist() for k, v in found.items()})
    return "plant.json"
