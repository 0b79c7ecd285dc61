"""An hour of a rod at 0.5 s: modes with static correction beside `solve_banded` with 500 cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_banded

from benchmarks.table import Result, judged
from benchmarks.timing import medians_s, shown
from observer.frames import FloatArray
from observer.model.build import build_plant
from observer.model.simulate import simulate, start
from tests.logs.inputs import even_inputs
from tests.logs.machines import config_of
from tests.truth.bar import Bar
from tests.truth.closed_forms import insulated_fin

STEPS, DT_S, CELLS, HEAT_W = 7200, 0.5, 500, 10.0
PLACES_M = np.array([0.0, 0.05, 0.28, 0.5, 0.72, 0.95, 1.0])
BAR = Bar()


def results() -> list[Result]:
    """Both ends heated with 10 W from the start, the worst of both for plain truncation."""
    time_s = DT_S * np.arange(1, STEPS + 1, dtype=float)
    left, right = (insulated_fin(BAR, x, HEAT_W, PLACES_M, time_s) for x in (0.0, 1.0))
    truth = 20.0 + left + right
    ours, peer = modal_hour(), banded_hour()
    taken = medians_s({"ours": ours, "peer": peer}, repetitions=5)
    errors = {name: np.abs(work() - truth) for name, work in (("ours", ours), ("peer", peer))}
    late = {name: float(error[119:].max()) for name, error in errors.items()}
    early = " / ".join(f"{errors['ours'][round(t / DT_S) - 1].max():.2g} K" for t in (0.5, 10.0))
    return [
        judged(
            "simulated hour, 40 modes + correction",
            shown(taken["ours"]),
            f"solve_banded, 500 cells {shown(taken['peer'])}",
            taken["peer"] / taken["ours"],
            at_least=400,
        ),
        Result(
            "  largest error from 60 s on",
            f"{late['ours']:.2g} K",
            f"{late['peer']:.2g} K",
            f"{late['ours'] / late['peer']:.2g} ×",
            "smaller",
            late["ours"] < late["peer"],
        ),
        Result("  0.5 s / 10 s after the heat's step", early, f"{errors['peer'][0].max():.2g} K at 0.5 s"),
    ]


def modal_hour() -> Callable[[], FloatArray]:
    """The plant with 40 modes, open loop."""
    config = config_of(40, 2, grid=2, output={"positions_m": PLACES_M.tolist()})
    plant = build_plant(config)
    inputs = even_inputs(plant, STEPS)
    inputs.dt_s[:] = DT_S
    inputs.law_W[:] = [0.0, HEAT_W, HEAT_W]

    def work() -> FloatArray:
        _, rows = simulate(plant, start(plant, 20.0, np.zeros(3)), inputs)
        return np.asarray(rows[:, plant.rows.field_slice])

    return work


def banded_hour() -> Callable[[], FloatArray]:
    """Finite volumes, Crank–Nicolson, as one writes them with scipy; read by interpolation."""
    dx = BAR.length_m / CELLS
    flow, film = BAR.conductance_Wm_K / dx, BAR.film_W_mK * dx
    half = 0.5 * DT_S / (BAR.capacity_J_mK * dx)
    diagonal = np.full(CELLS, 2.0 * flow + film)
    diagonal[[0, -1]] -= flow
    bands = np.zeros((3, CELLS))
    bands[0, 1:] = bands[2, :-1] = -half * flow
    bands[1] = 1.0 + half * diagonal
    load = np.full(CELLS, film * 20.0)
    load[[0, -1]] += HEAT_W
    nodes = np.concatenate([[0.0], (np.arange(CELLS) + 0.5) * dx, [BAR.length_m]])
    rise = HEAT_W / BAR.conductance_Wm_K * dx / 2.0  # from the end cell's centre to its face

    def work() -> FloatArray:
        T, rows = np.full(CELLS, 20.0), np.empty((STEPS, len(PLACES_M)))
        for k in range(STEPS):
            heat = load - diagonal * T
            heat[1:] += flow * T[:-1]
            heat[:-1] += flow * T[1:]
            T = solve_banded((1, 1), bands, T + half * (heat + load), check_finite=False)
            rows[k] = np.interp(PLACES_M, nodes, np.concatenate([[T[0] + rise], T, [T[-1] + rise]]))
        return rows

    return work
