"""The field of a machine at rest, against finite differences of screw and bodies that import nothing."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.sparse import diags_array, lil_array
from scipy.sparse.linalg import spsolve

from observer.config.machine import Config
from observer.installation import load, parse
from observer.model.bending import with_bending
from observer.model.build import build_plant, full_model
from observer.model.generator import generator
from observer.model.plant import Plant

LENGTH_M, DIAMETER_M, CONDUCTIVITY_W_MK, FILM_W_M2K = 0.6, 0.03, 50.0, 12.0
STROKE_M, LINK_W_K, LOSS_W_K, BEARING_W_K = (0.15, 0.40), 40.0, 3.0, 6.0
CELLS = 12_000
BEARING_M = 0.1 + LENGTH_M / CELLS / 2  # the middle of a cell
CONFIG = Path(__file__).parents[2] / "config"


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


def at_rest(plant: Plant) -> np.ndarray:
    """All outputs at rest per watt of each source and per unit of each known input."""
    of_heats, of_known = (plant.rows.C @ np.linalg.solve(-generator(plant), x) for x in (plant.B, plant.E))
    return np.hstack([of_heats, of_known + plant.rows.F])


def step_response(plant: Plant, time_s: float) -> np.ndarray:
    """The rises of all temperatures a time after steps of a watt of each source, K/W."""
    n, m = plant.B.shape
    driven = np.zeros((n + m, n + m))
    driven[:n, :n], driven[:n, n:] = generator(plant), plant.B
    rows = plant.rows.C[: plant.rows.sensors + plant.rows.grid]
    return rows @ expm(driven * time_s)[:n, n:]


@pytest.mark.parametrize("modes", [4, 15, 80])
def test_a_tied_nut_is_exact_at_rest_with_any_number_of_modes(modes: int) -> None:
    settled, expected = rises_at_rest(build_plant(tied_machine(modes))), finite_differences()
    # twice what the cells of the finite differences leave out
    np.testing.assert_allclose(settled, expected, atol=4e-7 * expected.max())


@pytest.mark.parametrize("name", sorted(path.stem for path in CONFIG.glob("*.toml")))
def test_every_shipped_machine_is_at_rest_as_with_300_modes(name: str) -> None:
    config = load(CONFIG / f"{name}.toml")
    many = config.model.model_copy(update={"modes": 300})
    few, reference = (at_rest(build_plant(c)) for c in (config, config.model_copy(update={"model": many})))
    # rounding; an isolated screw has its steady field beside a mean that would drift
    np.testing.assert_allclose(few, reference, atol=1e-7 * np.abs(reference).max())


def two_nuts(modes: int, stroke_m: tuple[float, float], link_W_K: float) -> Config:
    """The screw with a nut and a point source, both tied; the nut's position is not known."""
    config = tied_machine(modes)
    nut, bearing = config.source
    link, lost, held, away = config.link
    nut = nut.model_copy(update={"position_channel": None, "stroke_m": stroke_m})
    bearing = bearing.model_copy(update={"position_m": 0.552})
    links = (link.model_copy(update={"conductance_W_K": link_W_K}), lost, held, away)
    return config.model_copy(update={"source": (nut, bearing), "link": links})


@pytest.mark.parametrize("modes", [3, 12])
@pytest.mark.parametrize("link_W_K", [1.0, 66.6, 3e5])
@pytest.mark.parametrize("stroke_m", [(0.367, 0.504), (0.0, LENGTH_M)])
def test_a_tied_machine_is_passive(stroke_m: tuple[float, float], link_W_K: float, modes: int) -> None:
    config = two_nuts(modes, stroke_m, link_W_K)
    plant = build_plant(config)
    eigenvalues_1_s = np.linalg.eigvals(generator(plant))
    assert np.abs(eigenvalues_1_s.imag).max() < 1e-6 * np.abs(eigenvalues_1_s.real).max()
    assert eigenvalues_1_s.real.max() < 0.0
    assert np.isfinite(plant.rows.C).all()
    assert rises_at_rest(plant).min() > -1e-6 * rises_at_rest(plant).max()


def test_modes_that_bend_follow_a_strong_exchange_within_a_minute() -> None:
    config = load(CONFIG / "yu-dual-drive.toml")
    many = config.model.model_copy(update={"modes": 300})
    few, reference = (
        step_response(build_plant(c), 60.0) for c in (config, config.model_copy(update={"model": many}))
    )
    # twice what they leave out; without them it is 1.4 %
    np.testing.assert_allclose(few, reference, atol=1e-3 * reference.max())


def test_modes_that_bend_are_orthogonal_and_a_screw_alone_does_not_couple_them() -> None:
    config = tied_machine(10)
    full, kept, bent = with_bending(full_model(config, ()), range(10))
    modes = full.modes.take(kept)
    assert len(modes) == 10 + bent == 16
    np.testing.assert_allclose(modes.surface(), np.eye(len(modes)), atol=1e-9)
    h_m, film_1_s = 1e-4, modes.rod.diffusivity_m2_s * modes.rod.fin_1_m**2
    places_m = np.arange(h_m / 2, LENGTH_M, h_m)
    slopes = (modes.theta(places_m + h_m / 4) - modes.theta(places_m - h_m / 4)) / (h_m / 2)
    lost_1_s = slopes.T @ slopes * h_m + film_1_s * np.eye(len(modes))
    # midpoints and difference quotients are off by less than a thousandth of the fastest
    np.testing.assert_allclose(lost_1_s, np.diag(modes.decay_1_s), atol=1e-3 * modes.decay_1_s.max())


@pytest.mark.parametrize("name", ["demo-housings", "li-network", "yu-dual-drive"])
def test_no_heat_cools_any_place_of_a_machine_at_rest(name: str) -> None:
    rises_K_W = rises_at_rest(build_plant(load(CONFIG / f"{name}.toml")))
    assert rises_K_W.min() > -1e-9
    assert rises_K_W.max() > 0.1
