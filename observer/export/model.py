"""The reduced plant of a configuration as a form: heats in, field, sensors and thermal error out."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.config import Config
from observer.export import sequence
from observer.export.data import Exportable, plant_constants, unit_of
from observer.export.form import Form, Kind, Slot, identifiers
from observer.model.generator import known_columns


def model_form(config: Config) -> Form:
    """Return the plant of a configuration, stepped at its period. Raises `ConfigError` for what varies."""
    own = Exportable(config)
    plant, constants = own.plant, plant_constants(own)
    constants |= {"HEATS": 0, "REPORTED": 0, "NUT_AT": np.arange(len(plant.moving))}
    facts = [
        f"{len(plant.mode_index)} modes and {len(plant.source_names)} lags, exact at steps of "
        f"{own.period_s:g} s over which the inputs are held.",
        "The screw begins at start_degC, all lags at rest under the first heats.",
    ]
    return own.form("model", constants, _slots(own, constants), sequence.MODEL, facts)


def _slots(own: Exportable, c: dict[str, Any]) -> list[Slot]:
    plant, layout = own.plant, own.plant.layout
    sources, known = identifiers(plant.source_names), known_columns(plant)
    nuts = tuple(nut.channel for nut in plant.moving)
    places = tuple(f"{1000 * x:.10g}_mm" for x in layout.position_m)
    n, rows, weights = c["STATES"], c["ROWS"], c.get("PLACES", -1) + 1
    found = [
        Slot("law_W", "real", "input", "heat of each source", (len(sources),), sources, ("W",)),
        Slot("z", "real", "input", "air, ends, offsets and the error's reference", (len(known),),
             identifiers(known), tuple(map(unit_of, known))),
        Slot("value", "real", "input", "where each nut is", (len(nuts),), identifiers(nuts), ("m",)),
        Slot("start_degC", "real", "input", "the screw's temperature at the start", units=("degC",)),
        Slot("sensor_degC", "real", "output", "what each sensor reads", (len(layout.sensors),),
             identifiers(layout.sensors), ("degC",)),
        Slot("field_degC", "real", "output", "temperature along the screw", (len(places),), places,
             ("degC",)),
    ]  # fmt: skip
    if layout.has_error:
        found.append(
            Slot(
                "error_um", "real", "output", "thermal error along the screw", (len(places),), places, ("um",)
            )
        )
    remembered: list[tuple[str, Kind, tuple[int, ...]]] = [
        ("x", "real", (n,)), ("B", "real", (len(sources), n)), ("lag_C", "real", (len(nuts), rows)),
        ("z_before", "real", (len(known),)), ("weight", "real", (weights,)), ("nut_m", "real", (len(nuts),)),
        ("located", "bool", (len(nuts),)), ("late", "bool", (len(nuts),)), ("row", "real", (rows,)),
        ("begun", "bool", ()), ("started", "bool", ()), ("heat_W", "real", (0,)),
    ]  # fmt: skip
    return [*found, *(Slot(name, kind, "state", "", shape) for name, kind, shape in remembered)]
