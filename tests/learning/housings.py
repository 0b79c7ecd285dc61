"""Rough machines whose sensors sit on the nut and on both bearings' housings, and none on the screw."""

from __future__ import annotations

from dataclasses import replace

from tests.learning.machines import CONFIG, Rough, Specimen, draw
from tests.truth.machine.housings import on_bodies, with_bodies
from tests.truth.machine.machine import stream

HOUSED_CONFIG = on_bodies(CONFIG)
"""The configuration that such a machine's user has."""


def draw_housed(seed: int, number: int, links: float) -> Specimen:
    """Draw a rough machine with these bodies; each link is off by a part `links`, up or down."""
    plain = draw(seed, number, Rough())
    machine = with_bodies(plain.machine, links, stream(seed, "links", str(number)))
    return replace(plain, machine=machine, on_bodies=True)
