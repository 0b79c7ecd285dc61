"""Rough machines whose sensors sit on the nut and on both bearings' housings, and none on the screw."""

from __future__ import annotations

from dataclasses import replace

from tests.learning.machines import Rough, Specimen, draw
from tests.truth.machine.logs import configuration
from tests.truth.machine.machine import SENSORS, SOURCES, stream
from tests.truth.machine.physics import FloatArray, Physics

BODIES = ("nut_body", "left_housing", "right_housing")
CAPACITY_J_K = (600.0, 1500.0, 1500.0)
CONTACT_W_K = (8.0, 10.0, 10.0)
NUT_AIR_W_K = 0.5
"""A nut of 1.3 kg that half of its friction heats, and housings of 3.3 kg, on steel seats."""


def draw_housed(seed: int, number: int, links: float) -> Specimen:
    """Draw a rough machine with these bodies; each link is off by a part `links`, up or down."""
    plain = draw(seed, number, Rough())
    rng = stream(seed, "links", str(number))
    contact, air = rng.choice([-1.0, 1.0], 3), float(rng.choice([-1.0, 1.0]))
    physics = _with_bodies(plain.machine.physics, 1.0 + links * contact, 1.0 + links * air)
    machine = replace(
        plain.machine,
        physics=physics,
        lag_s=plain.machine.lag_s[:3],
        offset_K=plain.machine.offset_K[:3],
        drift_K_h=plain.machine.drift_K_h[:3],
        toward_air=plain.machine.toward_air[:3],
    )
    return replace(plain, machine=machine, on_bodies=True)


def _with_bodies(physics: Physics, contact: FloatArray, air: float) -> Physics:
    return physics._replace(
        body_J_K=physics.body_J_K * CAPACITY_J_K,
        body_W_K=contact * CONTACT_W_K,
        nut_body_share=1.0,
        nut_body_air_W_K=air * NUT_AIR_W_K,
    )


def _configuration() -> str:
    head, _, free = configuration(()).partition("\n[[sensor]]")
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
        for name, body in zip(SENSORS[:3], BODIES, strict=True)
    ]
    return "".join([head, *nodes, *sensors, calibrate])


HOUSED_CONFIG = _configuration()
"""The configuration that such a machine's user has."""
