"""An independent rod: the method of lines by scipy's stiff solver, with what no configuration says of a rod.

A block with an electric heater stands at x = 0, the other end is held at a temperature that is measured. The
film grows with the temperature excess as free convection does, the conductivity changes with temperature, and
the sensors are off, misplaced, late and coarse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.truth.machine.logs import write_log

FloatArray = NDArray[np.float64]
CELLS = 160
STEFAN_BOLTZMANN = 5.670374419e-8
ZERO_K = 273.15
SENSORS = tuple(f"t{i}" for i in range(1, 9))
CHANNELS = (*(f"{name}_degC" for name in SENSORS), "heater_W", "end_degC", "ambient_degC")
MATERIALS = {  # W/mK, J/m3K
    "brass": (115.0, 8500.0 * 380.0),
    "steel": (50.0, 7850.0 * 470.0),
    "aluminium": (200.0, 2700.0 * 900.0),
}
HIDDEN = ("nothing", "film", "radiation", "block")
FREE_CONVECTION = 0.2
"""The exponent with which the film of a rod in still air grows with the excess; in a draught it does not."""
AT_K = 20.0
"""The excess at which a film is what it is called."""


@dataclass(frozen=True)
class Rod:
    """One rod, and what is hidden in it; `late_s` is how long after the log's start the heater comes on."""

    hidden: str
    length_m: float
    diameter_m: float
    conductivity_W_mK: float
    capacity_J_m3K: float
    film_W_m2K: float
    exponent: float
    emissivity: float
    block_J_K: float
    contact_W_K: float
    power_W: float
    late_s: float
    lasts_s: float
    row_s: float
    air_degC: float
    place_m: FloatArray
    offset_K: FloatArray
    lag_s: FloatArray


class Log(NamedTuple):
    """What was logged: `values` (n, channels) at `time_s` (n,)."""

    time_s: FloatArray
    values: FloatArray


def draw(seed: int, hidden: str) -> Rod:
    """Draw a rod with something hidden in it."""
    rng = np.random.default_rng([seed, HIDDEN.index(hidden), 20261122])
    k, capacity = MATERIALS[str(rng.choice(list(MATERIALS)))]
    length_m, diameter_m = rng.uniform(0.25, 0.6), rng.uniform(0.008, 0.020)
    section_m2, skin_m2 = np.pi * diameter_m**2 / 4.0, np.pi * diameter_m * length_m
    W_K = section_m2 * k / length_m + 0.3 * 10.0 * skin_m2
    rod = Rod(
        hidden=hidden,
        length_m=length_m,
        diameter_m=diameter_m,
        conductivity_W_mK=k * rng.uniform(0.97, 1.03),
        capacity_J_m3K=capacity * rng.uniform(0.97, 1.03),
        film_W_m2K=rng.uniform(6.0, 12.0),
        exponent=float(rng.choice([0.0, FREE_CONVECTION])),
        emissivity=0.0,
        block_J_K=0.0,
        contact_W_K=0.0,
        power_W=float(np.round(rng.uniform(25.0, 60.0) * W_K, 1)),
        late_s=float(rng.choice([0.0, rng.uniform(60.0, 300.0)])),
        lasts_s=float(rng.uniform(1200.0, 3600.0)),
        row_s=float(rng.choice([1.0, 2.0, 5.0])),
        air_degC=float(rng.uniform(19.0, 25.0)),
        place_m=np.linspace(0.04, 0.94, len(SENSORS)) * length_m + rng.normal(0.0, 0.002, len(SENSORS)),
        offset_K=rng.normal(0.0, 0.3, len(SENSORS)),
        lag_s=rng.uniform(1.0, 4.0, len(SENSORS)),
    )
    if hidden == "radiation":
        emissivity = float(rng.uniform(0.6, 0.95))
        return replace(rod, emissivity=emissivity, film_W_m2K=float(rng.uniform(2.7, 3.3)), exponent=0.0)
    if hidden == "block":
        return replace(
            rod, block_J_K=float(rng.uniform(40.0, 200.0)), contact_W_K=float(rng.uniform(1.0, 6.0))
        )
    return rod


def run(rod: Rod) -> tuple[FloatArray, FloatArray]:
    """Return the rows' times (n,) and the rod's cells (n, cells) in °C, half of its time heated."""
    time_s = np.arange(0.0, rod.lasts_s, rod.row_s)
    width_m = rod.length_m / CELLS
    section_m2, skin_m2 = np.pi * rod.diameter_m**2 / 4.0, np.pi * rod.diameter_m * width_m
    stores_J_K = rod.capacity_J_m3K * section_m2 * width_m
    off_s = rod.late_s + 0.65 * (rod.lasts_s - rod.late_s)

    def slope(_t: float, state: FloatArray, power_W: float) -> FloatArray:
        cell = state[:CELLS]
        k = rod.conductivity_W_mK * (1.0 + 2e-4 * (cell - rod.air_degC))
        between = 0.5 * (k[1:] + k[:-1]) * section_m2 / width_m * (cell[1:] - cell[:-1])
        gain = np.zeros(CELLS)
        gain[:-1] += between
        gain[1:] -= between
        gain[-1] += k[-1] * section_m2 / (0.5 * width_m) * (rod.air_degC - cell[-1])
        excess = cell - rod.air_degC
        film = rod.film_W_m2K * (np.abs(excess) / AT_K + 1e-6) ** rod.exponent
        gain -= skin_m2 * film * excess
        gain -= (
            skin_m2
            * rod.emissivity
            * STEFAN_BOLTZMANN
            * ((cell + ZERO_K) ** 4 - (rod.air_degC + ZERO_K) ** 4)
        )
        if not rod.block_J_K:
            gain[0] += power_W
            return np.append(gain / stores_J_K, 0.0)
        flow_W = rod.contact_W_K * (state[CELLS] - cell[0])
        gain[0] += flow_W
        return np.append(gain / stores_J_K, (power_W - flow_W) / rod.block_J_K)

    state, parts = np.full(CELLS + 1, rod.air_degC), []
    edges = [0.0, rod.late_s, off_s, rod.lasts_s]
    for begin, end, power_W in zip(edges[:-1], edges[1:], (0.0, rod.power_W, 0.0), strict=True):
        if end <= begin:
            continue
        mine = time_s[(time_s >= begin) & (time_s < end)]
        solved = solve_ivp(
            slope, (begin, end), state, method="LSODA", t_eval=np.append(mine, end), args=(power_W,),
            lband=1, uband=1, rtol=1e-6, atol=1e-5,
        )  # fmt: skip
        parts.append(solved.y[:CELLS, :-1].T)
        state = solved.y[:, -1]
    return time_s, np.vstack(parts)


def logged(rod: Rod, seed: int) -> Log:
    """What the log shows: offsets, places, lags, noise, and steps of 0.1 K."""
    rng = np.random.default_rng([seed, HIDDEN.index(rod.hidden), 7])
    time_s, cells = run(rod)
    centre_m = (np.arange(CELLS) + 0.5) * rod.length_m / CELLS
    shown = np.column_stack([_late(np.array([np.interp(x, centre_m, row) for row in cells]), rod.row_s, lag)
                             for x, lag in zip(rod.place_m, rod.lag_s, strict=True)])  # fmt: skip
    shown = np.round((shown + rod.offset_K + rng.normal(0.0, 0.03, shown.shape)) / 0.1) * 0.1
    off_s = rod.late_s + 0.65 * (rod.lasts_s - rod.late_s)
    power_W = np.where((time_s >= rod.late_s) & (time_s < off_s), rod.power_W, 0.0)
    end_degC, air_degC = (np.round(rod.air_degC + rng.normal(0.0, 0.02, len(time_s)), 1) for _ in range(2))
    return Log(time_s, np.column_stack([shown, power_W, end_degC, air_degC]))


def _late(reading: FloatArray, row_s: float, lag_s: float) -> FloatArray:
    """A first-order lag by the recursion that is exact for held inputs."""
    share, out = 1.0 - np.exp(-row_s / lag_s), reading.copy()
    for i in range(1, len(out)):
        out[i] = out[i - 1] + share * (reading[i] - out[i - 1])
    return out


def configuration(rod: Rod) -> str:
    """What its owner writes: handbook values, and no film where it is what is hidden; where radiation is, the
    film that there is besides.
    """
    near = [k for k, (_, c) in MATERIALS.items() if abs(c / rod.capacity_J_m3K - 1.0) < 0.04]
    k, capacity = MATERIALS[min(near, key=lambda n: abs(MATERIALS[n][0] / rod.conductivity_W_mK - 1.0))]
    film = {"film": 0.0, "radiation": 3.0}.get(rod.hidden, 10.0)
    free = '\n[calibrate]\nfree = ["source.heater.scale"]\n' if rod.hidden == "radiation" else ""
    sensors = "".join(
        f'\n[[sensor]]\nname = "{name}"\nchannel = "{name}_degC"\nposition_m = {x:.3f}\nnoise_K = 0.05\n'
        for name, x in zip(SENSORS, np.linspace(0.04, 0.94, len(SENSORS)) * rod.length_m, strict=True)
    )
    return f"""\
[machine]
name = "rod"
axis = "x"

[screw]
length_m = {rod.length_m:.4f}
diameter_m = {rod.diameter_m:.4f}
conductivity_W_mK = {k}
density_kg_m3 = 1000.0
specific_heat_J_kgK = {capacity / 1000.0:.1f}

[surface]
convection_W_m2K = {film}

[ambient]
channel = "ambient_degC"

[boundary.left]
kind = "insulated"
[boundary.right]
kind = "prescribed"
channel = "end_degC"

[[source]]
name = "heater"
shape = "point"
position_m = 0.0
power_channel = "heater_W"
{sensors}{free}"""


def write(rod: Rod, seed: int, folder: Path) -> Path:
    """Write `rod.csv.gz` and `config.toml`; return the log."""
    folder.mkdir(parents=True, exist_ok=True)
    time_s, values = logged(rod, seed)
    path = folder / "rod.csv.gz"
    write_log(path, time_s, values, dict.fromkeys(CHANNELS, "%.2f"))
    (folder / "config.toml").write_text(configuration(rod), encoding="utf-8")
    return path
