"""The measured steel wall as a configuration and a log."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from observer.config.machine import Config
from observer.files.logs import Log
from observer.installation import parse
from tests.reference.service_path import log_of

DATA = Path(__file__).parents[1] / "data" / "steel-wall" / "DATA.csv"
UNIT_AREA_DIAMETER_M = 2.0 / math.sqrt(math.pi)
"""A bar of 1 m², so that watts are watts per square metre."""


def wall_config(random_walk_W_sqrt_s: float = 200.0) -> Config:
    """The wall with its documented parameters, read from the data's own first row."""
    first = _rows()[0]
    return parse(
        {
            "screw": {
                "length_m": float(first["Length"]),
                "diameter_m": UNIT_AREA_DIAMETER_M,
                "conductivity_W_mK": float(first["Material_lmbd"]),
                "density_kg_m3": float(first["Material_rho"]),
                "specific_heat_J_kgK": float(first["Material_cp"]),
            },
            "ambient": {"channel": "ambient_degC"},
            "boundary": {"right": {"kind": "convective", "coefficient_W_m2K": float(first["RobinAlpha"])}},
            "source": [
                {
                    "name": "flux",
                    "shape": "point",
                    "position_m": 0.0,
                    "power_channel": "flux_W",
                    "random_walk_W_sqrt_s": random_walk_W_sqrt_s,
                }
            ],
            "sensor": [
                {"name": "t1", "channel": "t1_degC", "position_m": float(first["x0"]), "noise_K": 0.05}
            ],
        }
    )


def wall_log(*, with_flux: bool = True) -> Log:
    """The measurement as a log; without the flux, what is left to find it from."""
    rows = _rows()
    flux_W = np.array([float(r["HeatFlux"]) for r in rows])
    columns = {
        "t1_degC": np.array([float(r["Temperature"]) for r in rows]),
        "flux_W": flux_W if with_flux else np.zeros_like(flux_W),
        "ambient_degC": np.array([float(r["T_amb"]) for r in rows]),
    }
    return log_of(np.array([float(r["Time"]) for r in rows]), columns)


def _rows() -> list[dict[str, str]]:
    with DATA.open(newline="") as file:
        return list(csv.DictReader(file))
