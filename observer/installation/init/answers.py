"""What `observer init` is told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Answers:
    """One machine's answers; lengths count from the screw's left end.

    `ambient` is a temperature in °C, or `"input"`: the module's next input after the sensors.
    """

    machine: str
    axis: str
    screw: str
    steel: str
    length_m: float
    stroke_m: tuple[float, float]
    sensors_m: tuple[float, ...]
    module: str
    module_at: str
    ambient: str
    control: str
    control_at: str = ""
    counts_per_m: float | None = None
    node_id: int | None = None
    position_register: int | None = None
    speed_register: int | None = None
    dbc: str = ""
    position_signal: str = ""
    speed_signal: str = ""
