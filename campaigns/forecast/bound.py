"""How well 28 minutes of a warm-up can say where it settles, whatever the estimator: a bound by information.

Sensitivities of the independent truth, by differences, of five sensors' means over half a minute, of the
settled field and error and of the time of settling, to everything that may be off; the prior of each is that
of a group of machines. P = (Π⁻¹ + JᵀJ/σ²)⁻¹ (Van Trees 1968, §2.4.3) bounds every estimator's covariance, to
first order. Friction is taken to run in exactly exponentially: for real machines the bound is higher.
`python -m campaigns.forecast.bound` prints the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from campaigns.forecast.days import WITHIN_UM
from campaigns.forecast.warming import REST_S, WARM_S, error_along
from observer.frames import FloatArray
from tests.learning.machines import GRID_M
from tests.truth.machine.cycles import Phase, STEP_s, build_schedule, steps_of
from tests.truth.machine.machine import SENSOR_M, SLICES
from tests.truth.machine.physics import plain_physics
from tests.truth.machine.run import run_machine

AIR_degC, END_W_K, MORE, RUNS_IN_S = 20.0, 0.05, 0.15, 2250.0
NOISE_K, MEAN_S = 0.05 / np.sqrt(30.0), 30.0
RUNS = Phase(14.0 * 3600.0, 1600.0, 0.2, 0.8)
_HEATS = ("nut", "left", "right")
_OFFSETS, _PLACES = (tuple(f"{word} {i}" for i in range(len(SENSOR_M))) for word in ("offset", "place"))
_MORE, _TIMES = (tuple(f"{word} {heat}" for heat in _HEATS) for word in ("more", "time"))

ROUGH: dict[str, float] = {
    "film": 0.3, "conductivity": 0.017, "capacity": 0.017, "end left": 0.03, "end right": 0.03, "air": 0.5,
    **dict.fromkeys(_HEATS, 0.25), **dict.fromkeys(_MORE, 0.09), **dict.fromkeys(_TIMES, 0.4),
    **dict.fromkeys(_OFFSETS, 0.3), **dict.fromkeys(_PLACES, 0.002),
}  # fmt: skip
"""One σ of everything: relative, in W/K, K and m; of times, of their logarithm."""
_RUN_IN_KNOWN = dict.fromkeys(_MORE, 0.03) | dict.fromkeys(_TIMES, 0.1)
_NO_RUN_IN = dict.fromkeys((*_MORE, *_TIMES), 1e-6)
_CALIBRATED = {"film": 0.024, **dict.fromkeys(_HEATS, 0.03)}
GROUPS: dict[str, Mapping[str, float]] = {
    "rough": ROUGH,
    "rough, friction does not run in": ROUGH | _NO_RUN_IN,
    "calibrated: film to 2.4 %, laws to 3 %": ROUGH | _CALIBRATED,
    "calibrated, and its run-in known to a fifth": ROUGH | _CALIBRATED | _RUN_IN_KNOWN,
    "calibrated, friction does not run in": ROUGH | _CALIBRATED | _NO_RUN_IN,
}
STEPS = {name: min(0.5 * sigma, 0.1) if sigma > 0.01 else sigma for name, sigma in ROUGH.items()}


class Seen(NamedTuple):
    """What is measured until then, (n,), and settled field, error (g,), °C and µm, and time, in min."""

    measured_degC: FloatArray
    field_degC: FloatArray
    error_um: FloatArray
    time_min: FloatArray


def run(off: Mapping[str, float]) -> Seen:
    """Run the machine with some parameters off."""
    o = dict.fromkeys(ROUGH, 0.0) | dict(off)
    plain = plain_physics(SLICES)
    physics = plain._replace(
        film_W_m2K=plain.film_W_m2K * (1.0 + o["film"]),
        conductivity_W_mK=plain.conductivity_W_mK * (1.0 + o["conductivity"]),
        capacity_J_m3K=plain.capacity_J_m3K * (1.0 + o["capacity"]),
        end_W_K=END_W_K + np.array([o["end left"], o["end right"]]),
        friction_W_rpm=plain.friction_W_rpm * (1.0 + np.array([o[name] for name in _HEATS])),
        run_in=MORE + np.array([o[name] for name in _MORE]),
        run_in_s=RUNS_IN_S * np.exp([o[name] for name in _TIMES]),
    )
    phases, air_degC = (Phase(REST_S), RUNS), AIR_degC + o["air"]
    schedule = build_schedule(phases, 0.3, np.full(steps_of(phases) + 1, air_degC))
    schedule = schedule._replace(start_degC=air_degC)
    places_m = SENSOR_M + np.array([o[name] for name in _PLACES])
    section_degC = run_machine(physics, schedule, np.concatenate([places_m, GRID_M])).section_degC
    seen_degC = section_degC[:, :5] + np.array([o[name] for name in _OFFSETS])
    now, block, last = (round(s / STEP_s) for s in (REST_S + WARM_S, MEAN_S, 120.0))
    error_um = error_along(section_degC[:, 5:] - air_degC, GRID_M)
    there_um = error_um[-last:].mean(axis=0)
    return Seen(
        seen_degC[1 : now + 1].reshape(-1, block, 5).mean(axis=1).ravel(),
        section_degC[-last:, 5:].mean(axis=0), there_um, np.array([_time_min(error_um[now:] - there_um)]),
    )  # fmt: skip


def _time_min(off_um: FloatArray) -> float:
    """When it is within the limit, by the exponential that its last part follows, of minute means."""
    minute = round(60.0 / STEP_s)
    total = np.cumsum(off_um, axis=0)
    most_um = np.abs((total[minute:] - total[:-minute]) / minute).max(axis=1)
    at = int(np.flatnonzero(most_um > WITHIN_UM)[-1])
    k = np.arange(max(at - 2400, 0), at + 1200)
    slope, level = np.polyfit(k * STEP_s / 60.0, np.log(most_um[k]), 1)
    return float((np.log(WITHIN_UM) - level) / slope)


def table() -> str:
    """The bound of each group: σ of the settled field and error, and the 95 % band of when."""
    here = run({})
    each = [
        Seen(*((a - b) / step for a, b in zip(run({name: step}), here, strict=True)))
        for name, step in STEPS.items()
    ]
    J, by_field, by_error, by_time = (np.array(column).T for column in zip(*each, strict=True))
    lines = ["| machine | settled field, σ | thermal error, σ | 95 % band of when |", "|---|---|---|---|"]
    for group, sigma in GROUPS.items():
        prior = np.diag([sigma[name] ** -2 for name in STEPS])
        P = np.linalg.inv(prior + J.T @ J / NOISE_K**2)
        K, um, minutes = (
            float(np.sqrt(np.mean(np.einsum("ij,jk,ik->i", rows, P, rows))))
            for rows in (by_field, by_error[1:], by_time)
        )
        lines.append(f"| {group} | {K:.2f} K | {um:.1f} µm | {2.0 * 1.96 * minutes:.0f} min |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
