"""What each tolerance costs, as plain data, and which one to improve first: `observer check`."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.config import Config
from observer.estimators.design.spread import Spread, spread
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.cycle import SPEED_RPM, standard_shift
from observer.model.learning import Nuisance
from observer.model.plant import Plant

MOST_MODES = 40
"""Modes faster than that have nothing in a σ, and much in the time that it takes."""
AS_KNOWN = 1e-3
"""What is left of a tolerance taken for known: not nothing, so that the filter starts the same way."""
WORTH_A_WORD = 0.05
"""The least fall of a σ for which a tolerance is named."""
CONFIGURED, ALL = "as configured", "all"


KEYS = {
    "conductivity": "take it from the maker's certificate of the screw's steel",
    "heat_capacity": "take it from the maker's certificate of the screw's steel",
    "convection": "let `observer calibrate` fit the film to a log with a cooling",
    "ambient_K": "put a thermometer, compared with the sensors, into the air at the screw",
    "end_W_K": "say in [boundary] what the ends lose, as a log of a cooling tells",
    "position_m": "measure where the sensors sit",
    "offset_K": "compare the sensors in a bath, or on the machine after a night at rest",
    "lag_s": "set the sensors into the metal with paste, or measure how late they are",
}
"""The keys of `[tolerance]`, and how each is made smaller."""


def tolerances(config: Config) -> dict[str, Any]:
    """Return `tolerances`, σ over the standard shift as configured, with each tolerance known and with all,
    and `improve_first`, by quantity the key whose knowledge would help most, or None where none helps much.

    Both are empty where the estimator has no gain, or where it would take long.
    """
    config = few_modes(config)
    plant = build_plant(config, learns=True)
    keys = np.array([Nuisance(kind).key for kind in plant.parameters.kind], np.str_)
    cases = [np.ones(len(keys))]
    cases += [np.where(keys == key, AS_KNOWN, 1.0) for key in KEYS]
    cases.append(np.where(keys == Nuisance.LAW.key, 1.0, AS_KNOWN))
    found = spread(plant, config.estimator, standard_shift(config, plant), np.array(cases))
    if found is None:
        return {"tolerances": [], "improve_first": {}}
    values: list[float | None] = [None, *(getattr(config.tolerance, key) for key in KEYS), None]
    rows = [
        _row(plant, found, i, key, value)
        for i, (key, value) in enumerate(zip((CONFIGURED, *KEYS, ALL), values, strict=True))
    ]
    return {"tolerances": rows, "improve_first": _first(found)}


def few_modes(config: Config) -> Config:
    """The configuration with no more modes than have a part in a σ."""
    if build_plant(config).modes <= MOST_MODES:
        return config
    return config.model_copy(update={"model": config.model.model_copy(update={"modes": MOST_MODES})})


def _row(plant: Plant, found: Spread, i: int, key: str, value: float | None) -> dict[str, Any]:
    return {
        "key": key,
        "tolerance": value,
        "heat_sigma_W": dict(zip(plant.layout.sources, found.heat_W[i].tolist(), strict=True)),
        "field_sigma_K": float(found.field_K[i]),
        "error_sigma_um": None if found.error_um is None else float(found.error_um[i]),
    }


def _first(found: Spread) -> dict[str, dict[str, Any] | None]:
    """By quantity the key that helps most, and by what part it makes σ smaller."""
    quantities = {"heat": np.sqrt(np.mean(found.heat_W**2, axis=1)), "field": found.field_K}
    if found.error_um is not None:
        quantities["error"] = found.error_um
    return {name: _best(sigma) for name, sigma in quantities.items()}


def _best(sigma: FloatArray) -> dict[str, Any] | None:
    """The best of the cases (v,) between the first, which is as configured, and the last, of all."""
    fall = 1.0 - sigma[1:-1] / sigma[0]
    best = int(np.argmax(fall))
    return {"key": list(KEYS)[best], "fall": float(fall[best])} if fall[best] >= WORTH_A_WORD else None


def advice(improve_first: dict[str, dict[str, Any] | None]) -> str:
    """Return a sentence of what to improve first, and how; no word where nothing was worked out."""
    if not improve_first:
        return "not worked out: there is no gain, or there are too many states"
    named: dict[str, list[str]] = {}
    for quantity, best in improve_first.items():
        if best is not None:
            named.setdefault(best["key"], []).append(f"σ of {_SAID[quantity]} -{best['fall']:.0%}")
    if not named:
        return "no single tolerance costs much"
    return "; ".join(f"{key} ({', '.join(falls)}): {KEYS[key]}" for key, falls in named.items())


SHIFT_SAID = f"σ below: means over two hours at {SPEED_RPM:g} rpm and an hour at rest, from ten minutes on"
"""The standard shift in words."""
_SAID = {"heat": "heats", "field": "field", "error": "error"}
