"""The reduced plant of a configuration, as a form and as matrices with names and units.

Its inputs are heats, its outputs field, sensors and thermal error. numpy, MATLAB and any reader of JSON can
load the matrices.
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.export import sequence
from observer.export.data import Exportable, force_slots, plant_constants
from observer.export.form import Form, Kind, Slot, identifiers
from observer.files.documents import write_json
from observer.model.generator import generator, known_columns, output_names
from observer.units import unit_of


def model_form(config: Config) -> Form:
    """Return the plant of a configuration, stepped at its period.

    Inputs are held over a step, and the result is exact for such inputs.

    Raises:
        ConfigError: If the plant varies with anything but the position of a nut.
    """
    machine = Exportable(config)
    plant, constants = machine.plant, plant_constants(machine)
    constants |= {"HEATS": 0, "REPORTED": 0, "NUT_AT": np.arange(len(plant.moving))}
    facts = [
        f"{len(plant.mode_index)} modes and {len(plant.source_names)} lags, exact at steps of "
        f"{machine.period_s:g} s over which the inputs are held.",
        "The screw begins at start_degC, all lags at rest under the first heats.",
    ]
    parts = [*sequence.MODEL, *(sequence.TENSION if plant.layout.has_force else ())]
    return machine.form("model", constants, _slots(machine, constants), parts, facts)


def _slots(machine: Exportable, c: dict[str, Any]) -> list[Slot]:
    """Return inputs, outputs and states of the plant, sized by the constants `c` of its code."""
    plant, layout = machine.plant, machine.plant.layout
    sources, known_inputs = identifiers(plant.source_names), known_columns(plant)
    nuts = tuple(nut.channel for nut in plant.moving)
    places = tuple(f"{1000 * x:.10g}_mm" for x in layout.position_m)
    n, rows, weights = c["STATES"], c["ROWS"], c.get("PLACES", -1) + 1
    slots = [
        Slot("law_W", "real", "input", "heat of each source", (len(sources),), sources, ("W",)),
        Slot("z", "real", "input", "air, ends, offsets and the error's reference", (len(known_inputs),),
             identifiers(known_inputs), tuple(map(unit_of, known_inputs))),
        Slot("value", "real", "input", "where each nut is", (len(nuts),), identifiers(nuts), ("m",)),
        Slot("start_degC", "real", "input", "the screw's temperature at the start", units=("degC",)),
        Slot("sensor_degC", "real", "output", "what each sensor reads", (len(layout.sensors),),
             identifiers(layout.sensors), ("degC",)),
        Slot("field_degC", "real", "output", "temperature along the screw", (len(places),), places,
             ("degC",)),
    ]  # fmt: skip
    if layout.has_error:
        slots.append(
            Slot(
                "error_um", "real", "output", "thermal error along the screw", (len(places),), places, ("um",)
            )
        )
    slots += force_slots(layout)
    remembered: list[tuple[str, Kind, tuple[int, ...]]] = [
        ("x", "real", (n,)), ("B", "real", (len(sources), n)), ("lag_C", "real", (len(nuts), rows)),
        ("z_before", "real", (len(known_inputs),)), ("weight", "real", (weights,)),
        ("nut_m", "real", (len(nuts),)), ("located", "bool", (len(nuts),)), ("late", "bool", (len(nuts),)),
        ("row", "real", (rows,)), ("begun", "bool", ()), ("started", "bool", ()), ("heat_W", "real", (0,)),
    ]  # fmt: skip
    return [*slots, *(Slot(name, kind, "state", "", shape) for name, kind, shape in remembered)]


def plant_matrices(config: Config) -> dict[str, Any]:
    """Return the matrices of dx/dt = A x + B q + E z, y = C x + F z, and of its steps (Ad, Bd, Ed).

    Heats q are in W, known inputs z in °C and K, and outputs y as in `estimates.csv`. A moving nut is spread
    over its stroke.

    Returns:
        The matrices as arrays: A and Ad (n, n), B and Bd (n, m), E and Ed (n, p), C (r, n), F (r, p). Beside
        them are `period_s`, the names and units of states, inputs and outputs, and the configuration's
        digest.

    Raises:
        ConfigError: If the plant varies with anything but the position of a nut.
    """
    machine = Exportable(config)
    plant, step = machine.plant, machine.step
    extra_states = len(plant.decay_1_s) - plant.lag_slice.stop
    outputs = output_names(plant)
    inputs = [*(f"heat_{name}_W" for name in plant.source_names), *known_columns(plant)]
    states = [*(f"mode {n}" for n in plant.mode_index), *(f"lag {name}" for name in plant.source_names)]
    states += [f"beside {n + 1}" for n in range(extra_states)]
    if plant.basis is not None:
        states = [f"own mode {n + 1}" for n in range(len(states))]
    return {
        "machine": config.machine.name, "axis": config.machine.axis, "configuration": config.digest,
        "version": version("ballscrew-observer"), "period_s": machine.period_s,
        "states": states, "inputs": inputs, "input_units": list(map(unit_of, inputs)),
        "outputs": outputs, "output_units": list(map(unit_of, outputs)),
        "A": generator(plant), "B": plant.B, "E": plant.E, "C": plant.rows.C, "F": plant.rows.F,
        "Ad": np.diag(step.decay), "Bd": step.hold[:, None] * plant.B, "Ed": step.hold[:, None] * plant.E,
    }  # fmt: skip


def write_npz(matrices: dict[str, Any], folder: Path) -> str:
    """Write `plant.npz`, lists of texts as arrays; `numpy.load` reads it without pickle.

    Returns:
        The file's name.

    Raises:
        OSError: If the file cannot be written.
    """
    np.savez(folder / "plant.npz", allow_pickle=False, **{k: np.asarray(v) for k, v in matrices.items()})
    return "plant.npz"


def write_mat(matrices: dict[str, Any], folder: Path) -> str:
    """Write `plant.mat` for MATLAB 5 and later, lists of texts as cell arrays.

    Returns:
        The file's name.

    Raises:
        OSError: If the file cannot be written.
    """
    from scipy.io import savemat  # noqa: PLC0415  (start-up: only this format needs it)

    cells = {k: np.array(v, dtype=object) if isinstance(v, list) else v for k, v in matrices.items()}
    savemat(folder / "plant.mat", cells, oned_as="column")
    return "plant.mat"


def write_plant_json(matrices: dict[str, Any], folder: Path) -> str:
    """Write `plant.json`, matrices as lists of rows.

    Returns:
        The file's name.

    Raises:
        OSError: If the file cannot be written.
    """
    write_json(folder / "plant.json", {k: np.asarray(v).tolist() for k, v in matrices.items()})
    return "plant.json"
