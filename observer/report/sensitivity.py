"""The limits of accuracy, as plain data for `observer check`: tolerances, and the faults that are noticed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.estimators.design.detectable import noticed, slow_faults_K
from observer.estimators.design.spread import NotDefined, Spread, spread, with_tolerances
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.cycle import SPEED_RPM
from observer.model.learning import Nuisance
from observer.model.plant import Plant

MOST_MODES = 40
"""Faster modes hardly change a σ, and cost most of the time."""
AS_KNOWN = 1e-3
"""Factor on a tolerance that is taken as known; not zero, so that the filter starts the same way."""
WORTH_A_WORD = 0.05
"""Least relative fall of a σ for which a tolerance is named."""
CONFIGURED, ALL = "as configured", "all"
PLACES = 11
"""Positions at which a further thermocouple is tried: every tenth of the screw."""
NEAREST_M = 0.02
"""Least distance from an existing sensor."""
_FURTHER = "a further one"  # no name that a configuration may have

KEYS = {
    "conductivity": "take it from the maker's certificate of the screw's steel",
    "heat_capacity": "take it from the maker's certificate of the screw's steel",
    "convection": "let `observer calibrate` fit the film to a log with a cooling",
    "ambient_K": "put a thermometer, compared with the sensors, in the air at the screw",
    "end_W_K": "enter the ends' losses in [boundary], from a log of a cooling",
    "position_m": "measure the sensors' positions",
    "offset_K": "compare the sensors in a bath, or on the machine after a night at rest",
    "lag_s": "set the sensors into the metal with paste, or measure their lag",
    "link": "free the links in [calibrate], on a log of one warm-up",
    "capacity": "weigh nut and housings, or take their masses from the drawing",
    "division": "put a thermocouple on the screw near the nut's stroke",
    "gain": "compare what looks at the screw or slides on it with a contact thermometer, once it is warm",
}
"""The keys of `[tolerance]`, and how to reduce each."""
OF_NODES = ("link", "capacity", "division")
"""Those of the bodies beside the screw."""
OF_PARTS = "gain"
"""That of sensors that show a part, known to a tolerance of their own."""
SHIFT_SAID = f"σ below: means over two hours at {SPEED_RPM:g} rpm and an hour at rest, from ten minutes on"
"""The standard shift in words."""
_PLURALS = {"heat": "heats", "field": "field", "error": "error"}


def tolerances(config: Config) -> dict[str, Any]:
    """Return σ over the standard shift, and the tolerances whose knowledge would help most.

    Returns:
        `tolerances`: a row as configured, one with each tolerance known, and one with all known.
            `improve_first`: by quantity the key that helps most, None where none helps by 5 %. Both are empty
            where σ is undefined or would take long; `tolerances_left_out` then has the reason, else None.
    """
    config = few_modes(config)
    plant = build_plant(config, learns=True)
    keys = np.array([Nuisance(kind).key for kind in plant.parameters.kind], np.str_)
    parts = [s.shows_tolerance for s in config.sensor if s.shows_tolerance is not None]
    keys_used = [
        key for key in KEYS if (config.node or key not in OF_NODES) and (any(parts) or key != OF_PARTS)
    ]
    cases = [np.ones(len(keys))]
    cases += [np.where(keys == key, AS_KNOWN, 1.0) for key in keys_used]
    cases.append(np.where(keys == Nuisance.LAW.key, 1.0, AS_KNOWN))
    sigma = spread(config, [with_tolerances(plant, case) for case in cases], config.reading_s)
    if isinstance(sigma, NotDefined):
        return {"tolerances": [], "improve_first": {}, "tolerances_left_out": f"not computed: {sigma.reason}"}
    configured = config.tolerance.model_dump() | {OF_PARTS: max(parts, default=0.0)}
    values: list[float | None] = [None, *(configured[key] for key in keys_used), None]
    rows = [
        _row(plant, sigma, i, key, value)
        for i, (key, value) in enumerate(zip((CONFIGURED, *keys_used, ALL), values, strict=True))
    ]
    return {"tolerances": rows, "improve_first": _first(sigma, keys_used), "tolerances_left_out": None}


def few_modes(config: Config) -> Config:
    """Return the configuration with at most 40 modes: faster ones hardly change a σ."""
    if build_plant(config).modes <= MOST_MODES:
        return config
    return config.model_copy(update={"model": config.model.model_copy(update={"modes": MOST_MODES})})


def _row(plant: Plant, sigma: Spread, i: int, key: str, value: float | None) -> dict[str, Any]:
    return {
        "key": key,
        "tolerance": value,
        "heat_sigma_W": dict(zip(plant.layout.sources, sigma.heat_W[i].tolist(), strict=True)),
        "field_sigma_K": float(sigma.field_K[i].mean()),
        "error_sigma_um": float(sigma.error_um[i].mean()) if sigma.error_um.size else None,
    }


def _first(sigmas: Spread, keys: Sequence[str]) -> dict[str, dict[str, Any] | None]:
    """By quantity, the key that helps most and the fraction by which it lowers σ."""
    quantities = {"heat": np.sqrt(np.mean(sigmas.heat_W**2, axis=1)), "field": sigmas.field_K.mean(axis=1)}
    if sigmas.error_um.size:
        quantities["error"] = sigmas.error_um.mean(axis=1)
    return {name: _best(sigma, keys) for name, sigma in quantities.items()}


def _best(sigma: FloatArray, keys: Sequence[str]) -> dict[str, Any] | None:
    """The best of the cases `keys` between the first, which is as configured, and the last, of all, (v,)."""
    fall = 1.0 - sigma[1:-1] / sigma[0]
    best = int(np.argmax(fall))
    return {"key": keys[best], "fall": float(fall[best])} if fall[best] >= WORTH_A_WORD else None


def advice(improve_first: dict[str, dict[str, Any] | None]) -> str:
    """Return a sentence on the first improvement to make, with the fall of σ and how to reach it.

    Args:
        improve_first: The entry of `tolerances`.
    """
    named: dict[str, list[str]] = {}
    for quantity, best in improve_first.items():
        if best is not None:
            named.setdefault(best["key"], []).append(f"σ of {_PLURALS[quantity]} -{best['fall']:.0%}")
    if not named:
        return "no single tolerance costs much"
    return "; ".join(f"{key} ({', '.join(falls)}): {KEYS[key]}" for key, falls in named.items())


def detectable(config: Config) -> dict[str, Any]:
    """Return the smallest faults of each temperature sensor that are noticed.

    Returns:
        `minimal_detectable`: by sensor `fault_K`, the smallest jump, `time_s`, within what time, and
            `slow_K`, the smallest slow fault, None where slow faults are not looked for. `further_sensor`:
            how one more would reduce the largest of these. `slow_in_sigma`: whether σ allows for slow faults
            that are not noticed. `not_screened`: the reason if nothing is computed, else None.
    """
    reason, faults = _why_not(config), None
    if reason is None:
        config = few_modes(config)
        faults = noticed(config, build_plant(config, learns=True))
        reason = f"not computed: {faults.reason}" if isinstance(faults, NotDefined) else None
    if faults is None or isinstance(faults, NotDefined):
        return {
            "minimal_detectable": {}, "further_sensor": None, "slow_in_sigma": False, "not_screened": reason
        }  # fmt: skip
    rows = {
        sensor.name: {"fault_K": jump_K, "time_s": time_s, "slow_K": _finite(slow_K)}
        for sensor, jump_K, time_s, slow_K in zip(
            config.sensor, *(column.tolist() for column in faults), strict=True
        )
        if sensor.kind == "temperature"
    }
    further = _further(config, faults.slow_K) if np.isfinite(faults.slow_K).all() else None
    return {
        "minimal_detectable": rows,
        "further_sensor": further,
        "slow_in_sigma": config.gives_bounds,
        "not_screened": None,
    }


def _why_not(config: Config) -> str | None:
    """Why no reading is screened, None where they are."""
    if not config.integrity.enabled:
        return "nothing is screened: [integrity] enabled = false; readings are refused by the gate alone"
    if not config.estimator.learns:
        kind = config.estimator.kind
        setting = f'engine = "{config.estimator.engine}"' if kind == "kalman" else f'kind = "{kind}"'
        return f"nothing is screened: {setting}; only the compiled Kalman filter does, others have their gate"
    return None


def _further(config: Config, slow_K: FloatArray) -> dict[str, Any] | None:
    """The gain of a further thermocouple at its best place, for the sensor that hides the largest fault.

    The places are the configured candidates; else the screw, if it carries a sensor; else the bodies, since
    nothing can be mounted on a screw that turns.
    """
    thermal = np.array([sensor.kind == "temperature" for sensor in config.sensor])
    worst = int(np.argmax(np.where(thermal, slow_K, 0.0)))
    best: dict[str, Any] | None = None
    for place in _places(config):
        extended = _with_another(config, place)
        slow = slow_faults_K(extended, build_plant(extended, learns=True), [worst])
        if isinstance(slow, NotDefined):
            return None
        least_K = float(slow[0])
        if best is None or least_K < best["slow_K_then"]:
            now = {"sensor": config.sensor[worst].name, "slow_K_now": float(slow_K[worst])}
            best = {**place, **now, "slow_K_then": least_K}
    return best


def _places(config: Config) -> Iterator[dict[str, Any]]:
    """Where a further thermocouple can be mounted: `position_m` on the screw, or the body it is `on`."""
    there_m = [s.position_m for s in config.sensor if s.position_m is not None]
    candidates = [c for c in config.candidate if c.kind == "temperature"]
    along_m = np.linspace(0.0, config.screw.length_m, PLACES).round(6).tolist() if there_m else []
    on = [node.name for node in config.node] if not there_m else []
    if candidates:
        on = [c.on for c in candidates if c.on is not None]
        along_m = [c.position_m for c in candidates if c.position_m is not None]
    for x_m in along_m:
        if min((abs(x_m - occupied_m) for occupied_m in there_m), default=math.inf) >= NEAREST_M:
            yield {"position_m": x_m, "on": None}
    for name in on:
        yield {"position_m": None, "on": name}


def _with_another(config: Config, place: Mapping[str, Any]) -> Config:
    """The configuration with one thermocouple more, like its first and read as often."""
    new = {"name": _FURTHER, **place}
    return config.model_copy(update={"sensor": (*config.sensor, config.sensor[0].model_copy(update=new))})


IN_BOUND = (
    "no bound is published: a slow fault that is not noticed passes for heat, and no sensor tells the two "
    "apart; arming goes by σ, which does not allow for it"
)
"""What is said where `slow_in_sigma` is false."""


def buys(further: dict[str, Any] | None) -> str:
    """Return a sentence on the gain of a further sensor; empty if it was not computed.

    Args:
        further: The entry `further_sensor` of `detectable`.
    """
    if further is None:
        return ""
    now_K, then_K, sensor = further["slow_K_now"], further["slow_K_then"], further["sensor"]
    on = further.get("on")
    if then_K > (1.0 - WORTH_A_WORD) * now_K:
        place = "on the screw" if on is None else "on nut or housings"
        return f"no further thermocouple {place} would bring {sensor}'s slow fault far below {now_K:.3g} K"
    place = f"at {further['position_m']:.3g} m" if on is None else f"more on {on}"
    return f"a thermocouple {place} would bring {sensor}'s slow fault from {now_K:.3g} to {then_K:.3g} K"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
