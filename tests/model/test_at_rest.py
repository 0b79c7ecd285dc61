"""The field of a machine at rest, against finite differences of screw and bodies that import nothing."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import diags_array, lil_array
from scipy.sparse.linalg import spsolve

from observer.config import Config
from observer.installation import load, parse
from observer.model.build import build_plant
from observer.model.generator import generator
from observer.model.plant import Plant

LENGTH_M, DIAMETER_M, CONDUCTIVITY_W_MK, FILM_W_M2K = 0.6, 0.03, 50.0, 12.0
STROKE_M, LINK_W_K, LOSS_W_K, BEARING_W_K = (0.15, 0.40), 40.0, 3.0, 6.0
CELLS = 12_000
BEARING_M = 0.1 + LENGTH_M / CELLS / 2  # the middle of a cell
CONFIG = Path(__file__).parents[2] / "config"
COUPLED = ("demo-housings", "li-network", "yu-dual-drive")


def tied_machine(modes: int) -> Config:
    """A short screw with a heavy exchange between its nut, which moves, and the body of the nut."""
    screw = {"length_m": LENGTH_M, "diameter_m": DIAMETER_M, "conductivity_W_mK": CONDUCTIVITY_W_MK}
    return parse(
        {
            "screw": screw | {"density_kg_m3": 7800.0, "specific_heat_J_kgK": 470.0},
            "surface": {"convection_W_m2K": FILM_W_M2K},
            "ambient": {"temperature_degC": 20.0},
            "model": {"modes": modes},
            "node": [{"name": "body", "capacity_J_K": 2000.0}, {"name": "housing", "capacity_J_K": 900.0}],
            "link": [
                {"between": ["body", "nut"], "conductance_W_K": LINK_W_K},
                {"between": ["body", "ambient"], "conductance_W_K": LOSS_W_K},
                {"between": ["housing", "bearing"], "conductance_W_K": BEARING_W_K},
                {"between": ["housing", "ambient"], "conductance_W_K": LOSS_W_K},
            ],
            "source": [
                {"name": "nut", "shape": "nut", "length_m": 0.05, "stroke_m": list(STROKE_M),
                 "position_channel": "nut_m", "nodes": {"body": 0.3}},
                {"name": "bearing", "shape": "point", "position_m": BEARING_M},
            ],
            "sensor": [{"name": "t1", "channel": "t1_degC", "position_m": 0.3},
                       {"name": "t2", "channel": "t2_degC", "on": "body", "shows": 0.8}],
            "output": {"positions_m": [0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6]},
        }
    )  # fmt: skip


def finite_differences() -> np.ndarray:
    """Rises of t1, t2 and the field per watt of nut and bearing, (10, 2); second order in the cells."""
    h_m = LENGTH_M / CELLS
    x_m = (np.arange(CELLS) + 0.5) * h_m
    along = CONDUCTIVITY_W_MK * np.pi * DIAMETER_M**2 / 4 / h_m
    own = np.full(CELLS, 2 * along + FILM_W_M2K * np.pi * DIAMETER_M * h_m)
    own[[0, -1]] -= along
    share = np.where((x_m > STROKE_M[0]) & (x_m < STROKE_M[1]), 1.0, 0.0)
    share /= share.sum()
    at = int(BEARING_M / h_m)
    bearing = np.zeros(CELLS)
    bearing[at] = 1.0
    K = lil_array((CELLS + 2, CELLS + 2))
    off = np.full(CELLS - 1, -along)
    K[:CELLS, :CELLS] = diags_array([own + LINK_W_K * share, off, off], offsets=[0, 1, -1])
    K[:CELLS, CELLS] = K[CELLS, :CELLS] = -LINK_W_K * share
    K[CELLS, CELLS] = LINK_W_K + LOSS_W_K
    for i, j, sign in ((at, at, 1), (CELLS + 1, CELLS + 1, 1), (at, CELLS + 1, -1), (CELLS + 1, at, -1)):
        K[i, j] += sign * BEARING_W_K
    K[CELLS + 1, CELLS + 1] += LOSS_W_K
    heat = np.zeros((CELLS + 2, 2))
    heat[:CELLS, 0], heat[CELLS, 0], heat[:CELLS, 1] = 0.7 * share, 0.3, bearing
    rise = spsolve(K.tocsr(), heat)
    places = [0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6]
    field = [np.interp([0.3, *places], x_m, rise[:CELLS, j]) for j in range(2)]
    field = np.array(field).T
    return np.vstack([field[:1], 0.8 * rise[CELLS], field[1:]])


def rises_at_rest(plant: Plant) -> np.ndarray:
    """The rises of all temperatures per watt of each source, K/W."""
    rows = plant.rows.C[: plant.rows.sensors + plant.rows.grid]
    return rows @ np.linalg.solve(-generator(plant), plant.B)


@pytest.mark.parametrize(("modes", "part"), [(15, 0.017), (40, 1.1e-3), (80, 1e-4)])
def test_more_modes_bring_a_tied_nut_closer_to_finite_differences_at_rest(modes: int, part: float) -> None:
    settled, expected = rises_at_rest(build_plant(tied_machine(modes))), finite_differences()
    # the exchange bends the field under the stroke; twice what modes cannot follow (0.84, 0.055, 0.005 %)
    np.testing.assert_allclose(settled, expected, atol=part * expected.max())


@pytest.mark.parametrize("name", COUPLED)
def test_no_heat_cools_any_place_of_a_machine_at_rest(name: str) -> None:
    rises_K_W = rises_at_rest(build_plant(load(CONFIG / f"{name}.toml")))
    assert rises_K_W.min() > -1e-9
    assert rises_K_W.max() > 0.1
