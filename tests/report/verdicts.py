"""What searches found, as far as their sentences and pages need it."""

from __future__ import annotations

from typing import Any

from observer.config.effects.catalogue import BY_KIND
from observer.discovery.candidates import Candidate

BASE: dict[str, Any] = {
    "verdict": "none",
    "effects": [],
    "calibrated": {},
    "gap": {
        "before_rms_K": 0.05, "after_rms_K": 0.05, "floor_rms_K": 0.007, "as_given_rms_K": 1.2731,
        "beyond_tolerances": {"before_rms_K": 0.031, "after_rms_K": 0.031},
    },
    "family": None,
    "partial": None,
    "where": [],
    "ranking": [],
    "experiment": None,
    "displacements": None,
    "suspects": [],
    "worth": None,
}  # fmt: skip
FELL = {
    "before_rms_K": 0.63, "after_rms_K": 0.156, "floor_rms_K": 0.007, "as_given_rms_K": 1.27,
    "beyond_tolerances": {"before_rms_K": 0.61, "after_rms_K": 0.042},
}  # fmt: skip
FILM = {"coefficient_W_m2K": {"value": 4.53, "ci95": [4.12, 4.94], "unit": "W/m2K"}}
SURFACE = {
    "name": "surface_loss", "target": None, "members": ["surface_convection", "radiation"], "effective": FILM
}  # fmt: skip
BODY = {
    "kind": "attached_mass", "target": "left", "share": 0.836, "remains_rms_K": 1.41,
    "remains_beyond_tolerances_rms_K": 0.92, "most_on": "t1", "phase": "heat_up", "family": None,
    "parameters": {"capacity_J_K": {"value": 150.0, "ci95": [140.0, 160.0], "unit": "J/K"}},
}  # fmt: skip
TEST = {
    "name": "soak",
    "description": "stand still",
    "duration_s": 7200.0,
    "separation_sigma": 21.3,
    "program": "test-cycle.csv",
}


def candidate(kind: str, target: str | None = None) -> Candidate:
    return Candidate(BY_KIND[kind], target, (), {})
