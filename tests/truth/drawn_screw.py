"""Solid screws of any size in finite volumes, each with at most one effect that its configuration lacks.

Slices along the screw conduct by implicit Euler; heats, films and losses act over each second. Material,
film and laws are off as a typical user's are. Sensors are off by 0.3 K and 2 mm, on half of the screws by 2 %
of their rise as well, and read in steps of 0.1 K.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.truth.bar import Bar, FloatArray, Mesh, nut_share, shuttle_m
from tests.truth.machine.logs import write_log

SLICES = 80
STEP_S = 1.0
NUT_M, LEAD_M = 0.06, 0.01
PATH_PARTS = 10
"""Places of the nut's path in each second."""
REFERENCE_K = 20.0
"""The rise above the air at which a film in still air has its nominal coefficient."""
STEFAN_BOLTZMANN = 5.670374419e-8
HIDDEN = {
    "nothing": 0.0,
    "end_conduction": 0.15,  # W/K at the left end
    "friction_fade": 0.02,  # 1/K of the nut
    "still_air": 0.25,  # exponent of the film's growth with the local rise
    "radiation": 0.9,  # emissivity
    "speed_convection": 0.3,  # of the film of a cylinder that turns in still air
}


@dataclass(frozen=True)
class DrawnScrew:
    """A screw as it is. `bar` has the true material and film; the configuration has the nominal values."""

    hidden: str
    strength: float
    seed: int
    nominal: Bar
    bar: Bar
    nut_W_rpm: float
    bearing_W_rpm: FloatArray
    nominal_position_m: FloatArray
    position_m: FloatArray
    offset_K: FloatArray
    gain: FloatArray
    air_degC: float
    most_rpm: float


def draw(seed: int, hidden: str, strength: float | None = None) -> DrawnScrew:
    """Return the screw of a seed with one effect of `HIDDEN`, at its usual strength unless one is given."""
    rng = np.random.default_rng([20261128, seed])
    length_m, diameter_m = rng.uniform(0.6, 1.6), rng.uniform(0.02, 0.04)
    nominal = Bar(length_m=length_m, diameter_m=diameter_m, convection_W_m2K=float(rng.uniform(8.0, 16.0)))
    off = 1.0 + 0.03 * rng.standard_normal(3)
    bar = Bar(
        length_m, diameter_m, nominal.conductivity_W_mK * off[0], nominal.density_kg_m3 * off[1],
        nominal.specific_heat_J_kgK, nominal.convection_W_m2K * (1.0 + 0.3 * (off[2] - 1.0) / 0.03),
    )  # fmt: skip
    sensors = int(rng.integers(3, 6))
    nominal_m = np.linspace(rng.uniform(0.02, 0.1), rng.uniform(0.9, 0.98), sensors) * length_m
    surface_W_K = bar.film_W_mK * length_m
    most_rpm = float(rng.uniform(400.0, 800.0))
    heat_W_rpm = surface_W_K * rng.uniform(15.0, 25.0) / most_rpm
    return DrawnScrew(
        hidden=hidden,
        strength=HIDDEN[hidden] if strength is None else strength,
        seed=seed,
        nominal=nominal,
        bar=bar,
        nut_W_rpm=0.6 * heat_W_rpm,
        bearing_W_rpm=0.2 * heat_W_rpm * rng.uniform(0.6, 1.4, 2),
        nominal_position_m=nominal_m,
        position_m=nominal_m + 0.002 * rng.standard_normal(sensors),
        offset_K=0.3 * rng.standard_normal(sensors),
        gain=1.0 - rng.choice([0.0, 0.02]) * np.abs(rng.standard_normal(sensors)),
        air_degC=float(rng.uniform(18.0, 25.0)),
        most_rpm=most_rpm,
    )


def programme_rpm(screw: DrawnScrew, run: int) -> FloatArray:
    """Return the speed (K,) of each second of a run: three speeds with rests, and a long rest at the end."""
    rng = np.random.default_rng([20261128, screw.seed, run])
    shares = rng.permutation([1.0, 0.6, 0.3]) * rng.uniform(0.9, 1.1, 3)
    lasts_s = [300, 1800, 600, 1800, 300, 1500, 1500]
    speeds = [0.0, shares[0], 0.0, shares[1], 0.0, shares[2], 0.0]
    return np.repeat(np.round(np.array(speeds) * screw.most_rpm), lasts_s)


def friction_W(screw: DrawnScrew, rpm: float, under_nut_K: float) -> float:
    """Return the nut's heat at a speed; where it fades, it falls with the temperature under the nut."""
    fade_1_K = screw.strength if screw.hidden == "friction_fade" else 0.0
    return screw.nut_W_rpm * rpm * math.exp(-fade_1_K * (screw.air_degC - 20.0 + under_nut_K))


def loss_W(screw: DrawnScrew, rise_K: FloatArray, rpm: float) -> FloatArray:
    """Return what each slice (SLICES,) loses at its rise above the air and a speed.

    In still air h = h₀ (ΔT/ΔT₀)ⁿ: in laminar free convection Nu ∝ Ra^¼, so that n = ¼.
    """
    bar, strength = screw.bar, screw.strength
    skin_m2 = math.pi * bar.diameter_m * bar.length_m / SLICES
    film_W_m2K, other_W = np.full(SLICES, bar.convection_W_m2K), np.zeros(SLICES)
    match screw.hidden:
        case "still_air":
            film_W_m2K = film_W_m2K * (np.abs(rise_K) / REFERENCE_K) ** strength
        case "speed_convection":
            reynolds = 2.0 * math.pi * rpm / 60.0 * bar.diameter_m**2 / 15.5e-6
            nusselt = 0.133 * reynolds ** (2 / 3) * 0.72 ** (1 / 3)
            film_W_m2K = film_W_m2K + strength * nusselt * 0.0257 / bar.diameter_m
        case "radiation":
            around_K = screw.air_degC + 273.15
            other_W = skin_m2 * strength * STEFAN_BOLTZMANN * ((rise_K + around_K) ** 4 - around_K**4)
        case "end_conduction":
            other_W[0] = strength * rise_K[0]
    return np.asarray(skin_m2 * film_W_m2K * rise_K + other_W)


def simulate(screw: DrawnScrew, run: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return time (K + 1,), true temperatures at the sensors (K + 1, s), the nut's place and the speed."""
    bar, mesh = screw.bar, Mesh(screw.bar.length_m, SLICES)
    speed_rpm = programme_rpm(screw, run)
    time_s = np.arange(len(speed_rpm) + 1) * STEP_S
    low_m, high_m = 0.15 * bar.length_m, 0.85 * bar.length_m
    travel_m = np.concatenate([[0.0], np.cumsum(speed_rpm) / 60.0 * LEAD_M * STEP_S])
    part_m = (np.arange(PATH_PARTS) + 0.5) / PATH_PARTS * np.diff(travel_m)[:, None]
    covered = nut_share(mesh, NUT_M, shuttle_m(travel_m[:-1, None] + part_m, low_m, high_m, 1.0))
    store_J_K, G = bar.capacity_J_mK * mesh.width_m, bar.conductance_Wm_K / mesh.width_m
    K = np.diag(np.full(SLICES, 2.0 * G)) - G * (np.eye(SLICES, k=1) + np.eye(SLICES, k=-1))
    K[0, 0] = K[-1, -1] = G
    conduct = np.linalg.inv(np.eye(SLICES) + STEP_S / store_J_K * K)
    rise_K, field_K = np.zeros(SLICES), np.zeros((len(time_s), SLICES))
    for k, rpm in enumerate(speed_rpm):
        heat_W = friction_W(screw, rpm, float(covered[k] @ rise_K)) * covered[k] - loss_W(screw, rise_K, rpm)
        heat_W[[0, -1]] += screw.bearing_W_rpm * rpm
        rise_K = conduct @ (rise_K + STEP_S / store_J_K * heat_W)
        field_K[k + 1] = rise_K
    shown = [[np.interp(x, mesh.centres_m, row) for row in field_K] for x in screw.position_m]
    nut_m = shuttle_m(travel_m, low_m, high_m, 1.0)
    return time_s, screw.air_degC + np.column_stack(shown), nut_m, np.append(speed_rpm, 0.0)


def write(screw: DrawnScrew, folder: Path, runs: int = 3) -> list[Path]:
    """Write `config.toml` and the logs of a screw; return the logs."""
    folder.mkdir(parents=True, exist_ok=True)
    logs = []
    for run in range(runs):
        time_s, true_degC, nut_m, speed_rpm = simulate(screw, run)
        rng = np.random.default_rng([20261128, screw.seed, run, 1])
        shown = screw.air_degC + screw.gain * (true_degC - screw.air_degC) + screw.offset_K
        shown = np.round((shown + 0.05 * rng.standard_normal(shown.shape)) / 0.1) * 0.1
        air = np.round(screw.air_degC + 0.02 * rng.standard_normal(len(time_s)), 1)
        names = [f"t{i + 1}_degC" for i in range(shown.shape[1])]
        formats = dict.fromkeys(names, "%.1f") | {
            "nut_position_m": "%.4f", "screw_speed_rpm": "%.0f", "ambient_degC": "%.1f",
        }  # fmt: skip
        logs.append(folder / f"run_{run + 1}.csv.gz")
        write_log(logs[-1], time_s, np.column_stack([shown, nut_m, speed_rpm, air]), formats)
    (folder / "config.toml").write_text(configuration(screw), encoding="utf-8")
    return logs


def configuration(screw: DrawnScrew) -> str:
    """Return the configuration of the screw's user, with handbook values and default tolerances."""
    bar = screw.nominal
    sources = "".join(
        f'\n[[source]]\nname = "{name}"\nshape = "point"\nposition_m = {x_m:.4f}\n'
        f'speed_channel = "screw_speed_rpm"\nheat_W_rpm = {0.2 * screw.nut_W_rpm / 0.6:.6f}\n'
        for name, x_m in (("left_bearing", 0.0), ("right_bearing", bar.length_m))
    )
    sensors = "".join(
        f'\n[[sensor]]\nname = "t{i}"\nchannel = "t{i}_degC"\nposition_m = {x_m:.4f}\nnoise_K = 0.05\n'
        for i, x_m in enumerate(screw.nominal_position_m, 1)
    )
    return f"""\
[machine]
name = "drawn"
axis = "x"

[screw]
length_m = {bar.length_m:.4f}
diameter_m = {bar.diameter_m:.4f}
conductivity_W_mK = {bar.conductivity_W_mK}
density_kg_m3 = {bar.density_kg_m3}
specific_heat_J_kgK = {bar.specific_heat_J_kgK}

[surface]
convection_W_m2K = {bar.convection_W_m2K:.1f}

[ambient]
channel = "ambient_degC"

[boundary.left]
kind = "insulated"
[boundary.right]
kind = "insulated"

[[source]]
name = "nut"
shape = "nut"
length_m = {NUT_M}
stroke_m = [{0.15 * bar.length_m:.4f}, {0.85 * bar.length_m:.4f}]
position_channel = "nut_position_m"
speed_channel = "screw_speed_rpm"
lead_m = {LEAD_M}
torque_Nm = {screw.nut_W_rpm / 0.5 / (math.pi / 30.0):.4f}
share = 0.5
{sources}{sensors}"""
