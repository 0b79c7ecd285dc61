"""The machine with bodies on its nut and its bearings, which carry its only thermocouples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.truth.machine.machine import SENSORS, SOURCES, Machine
from tests.truth.machine.physics import FloatArray

BODIES = ("nut_body", "left_housing", "right_housing")
CAPACITY_J_K = (600.0, 1500.0, 1500.0)
CONTACT_W_K = (8.0, 10.0, 10.0)
NUT_AIR_W_K = 0.5
"""A nut of 1.3 kg that half of its friction heats, and housings of 3.3 kg, on steel seats."""


def with_bodies(machine: Machine, links: float, rng: np.random.Generator) -> Machine:
    """The machine with its first three sensors on these bodies; each link is off by a part `links`, up or
    down.
    """
    contact, air = rng.choice([-1.0, 1.0], 3), float(rng.choice([-1.0, 1.0]))
    physics = machine.physics._replace(
        body_J_K=machine.physics.body_J_K * CAPACITY_J_K,
        body_W_K=(1.0 + links * contact) * CONTACT_W_K,
        nut_body_share=1.0,
        nut_body_air_W_K=(1.0 + links * air) * NUT_AIR_W_K,
    )
    return replace(
        machine,
        physics=physics,
        lag_s=_on_bodies(machine.lag_s),
        offset_K=_on_bodies(machine.offset_K),
        drift_K_h=_on_bodies(machine.drift_K_h),
        toward_air=_on_bodies(machine.toward_air),
    )


def _on_bodies(of_sensors: FloatArray) -> FloatArray:
    return of_sensors[: len(BODIES)]


def on_bodies(text: str) -> str:
    """The configuration that the user of such a machine has, from one with sensors on the screw."""
    head, _, free = text.partition("\n[[sensor]]")
    calibrate = free[free.index("\n[calibrate]") :]
    head = head.replace("share = 0.5\n", "nodes = { nut_body = 0.5 }\n")
    nodes = [
        f'\n[[node]]\nname = "{name}"\ncapacity_J_K = {capacity_J_K}\n'
        f'\n[[link]]\nbetween = ["{source}", "{name}"]\nconductance_W_K = {contact_W_K}\n'
        for name, source, capacity_J_K, contact_W_K in zip(
            BODIES, SOURCES, CAPACITY_J_K, CONTACT_W_K, strict=True
        )
    ]
    nodes.append(f'\n[[link]]\nbetween = ["nut_body", "ambient"]\nconductance_W_K = {NUT_AIR_W_K}\n')
    sensors = [
        f'\n[[sensor]]\nname = "{name}"\nchannel = "{name}_degC"\non = "{body}"\nnoise_K = 0.05\n'
        for name, body in zip(SENSORS[: len(BODIES)], BODIES, strict=True)
    ]
    return "".join([head, *nodes, *sensors, calibrate])
