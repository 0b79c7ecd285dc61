"""A running machine and its wires, in memory: readings that come late, twice or never, through the live path.

The machine is the simulated one (finite volumes, its own friction), which knows nothing of the model; what
reaches the service, and when, is up to each test.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from drivers.simulated.machine import SimulatedMachine as Axis
from drivers.simulated.machine import heats, speed_rpm
from observer.align.aligner import Aligner
from observer.config.machine import Config
from observer.estimate.pipeline import MachineModel
from observer.frames import EstimateBlock, FloatArray, Reading
from observer.installation import load
from observer.quality.conditions import of_finding

DEMO = Path(__file__).parents[2] / "config" / "demo.toml"
EPOCH_S = 1.8e9
FRAME_S, POLL_S, STEP_S = 0.02, 0.5, 0.02
WARM_S = 1200.0

Arrivals = list[tuple[float, Reading]]
"""When a reading arrives, and what it says; its own time is that of its source, or of its arrival."""
Wires = Callable[[Arrivals], Iterable[tuple[float, Reading]]]


@dataclass(frozen=True, slots=True)
class Ride:
    """What a ride gave: estimates, true heats (K, 3), and what the service said of itself at each step."""

    block: EstimateBlock
    truth_W: FloatArray
    reasons: list[tuple[str, ...]]

    @property
    def off_sigma(self) -> FloatArray:
        """How many σ each heat is off, (K, 3)."""
        return (self.block.heat_W - self.truth_W) / self.block.heat_sigma_W


def demo() -> Config:
    """The demo's configuration."""
    return load(DEMO)


def sent(seconds: float, seed: int = 1) -> Arrivals:
    """What the machine sends while it runs: frames of position and speed, and polled thermocouples."""
    axis = Axis(seed)
    for _ in range(round(WARM_S / 0.1)):
        axis.advance(0.1)
    begin_s, out = axis.time_s, []
    for k in range(1, round(seconds / STEP_S) + 1):
        axis.advance(STEP_S)
        at_s = EPOCH_S + axis.time_s - begin_s
        motion = {"nut_position_m": axis.nut_position_m(), "screw_speed_rpm": speed_rpm(axis.time_s)}
        out.append((at_s, Reading(at_s, motion)))
        if k % round(POLL_S / STEP_S) == 0:
            rounded = {name: round(value, 1) for name, value in axis.thermocouples_degC().items()}
            out.append((at_s - 0.004, Reading(at_s - 0.004, rounded)))
    return out


def in_time(arrivals: Arrivals) -> Arrivals:
    """Wires that deliver at once."""
    return arrivals


def ride(config: Config, arrivals: Arrivals, wires: Wires = in_time) -> Ride:
    """Deliver what a machine sends through wires to the service's path, tick by tick."""
    machine = MachineModel.of(config)
    aligner, pipeline = (
        Aligner(machine.plan),
        machine.pipeline(machine.estimator()),
    )
    blocks, truth, reasons = [], [], []
    begin_s = arrivals[0][0]
    period_s = machine.plan.period_s
    tick_s = begin_s + period_s
    for at_s, reading in _in_order(wires(arrivals)):
        while at_s > tick_s:
            blocks.append(pipeline.step(aligner.tick(tick_s)))
            faults = (f"{name}: {fault}" for name, fault in aligner.faults.items())
            reasons.append((*faults, *(of_finding(f).sentence for f in pipeline.findings)))
            truth.append(tick_s)
            tick_s += period_s
        aligner.ingest(reading)
    block = EstimateBlock(
        *(np.concatenate([getattr(b, f.name) for b in blocks]) for f in fields(EstimateBlock))
    )
    return Ride(block, true_heats(np.array(truth) - EPOCH_S), reasons)


def true_heats(since_s: FloatArray) -> FloatArray:
    """The machine's heats (K, 3) at times since the start of the log, mean over the tick before."""
    out = []
    for t in since_s:
        parts = [heats(WARM_S + t - POLL_S * (i + 0.5) / 10) for i in range(10)]
        out.append(np.mean([(p.nut_W, p.left_bearing_W, p.right_bearing_W) for p in parts], axis=0))
    return np.array(out)


def _in_order(deliveries: Iterable[tuple[float, Reading]]) -> Iterator[tuple[float, Reading]]:
    """Deliveries by the time of their arrival."""
    heap = [(at_s, i, reading) for i, (at_s, reading) in enumerate(deliveries)]
    heapq.heapify(heap)
    while heap:
        at_s, _, reading = heapq.heappop(heap)
        yield at_s, reading
