"""What a step hands out is nobody's scratch: it stays as it is while later steps run, in any thread."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from observer.align.aligner import Aligner
from observer.estimate.pipeline import MachineModel
from observer.frames import Reading
from tests.bits.digests import numbers
from tests.reference import live


def arrays_in(value) -> Iterator[np.ndarray]:
    """Every array in what a step hands out."""
    if isinstance(value, np.ndarray):
        yield numbers(value)
    elif is_dataclass(value):
        yield from arrays_in([getattr(value, field.name) for field in fields(value)])
    elif isinstance(value, dict):
        yield from arrays_in(list(value.values()))
    elif isinstance(value, tuple | list):
        for one in value:
            yield from arrays_in(one)


def built(kind):
    machine = MachineModel.of(live.demo(), learns=True)
    settings = machine.config.estimator.model_copy(update={"kind": kind})
    machine.config.__dict__["estimator"] = settings
    return machine, machine.estimator(), machine.self_test()


def ticks(machine, estimator, test, seed, steps=30) -> Iterator[list[np.ndarray]]:
    """The arrays handed out at each of some live ticks: of frame, inputs, estimate and all states."""
    rng, aligner = np.random.default_rng(seed), Aligner(machine.plan)
    drive, known, tested = machine.drive.initial(), estimator.initial(), test.initial()
    for k in range(steps):
        for part in range(k):  # in the end more rows wait for a tick than ever before
            values = {name: float(20.0 + rng.random()) for name in machine.plan.channels}
            values |= {"nut_position_m": 0.3 + 0.1 * rng.random(), "screw_speed_rpm": 900.0 * rng.random()}
            aligner.ingest(Reading(0.5 * k + 0.01 * part, values))
        frame = aligner.tick(0.5 * k + 0.4)
        drive, inputs = machine.drive.run(drive, frame)
        tested, motion, watched = test.watch(tested, frame, inputs)
        known, estimate = estimator.run(known, watched)
        tested, judged = test.run(tested, motion, watched, estimate)
        yield list(arrays_in([frame, inputs, watched, motion, estimate, judged, drive, known, tested]))


@pytest.mark.parametrize("kind", ["kalman", "luenberger"])
def test_threads_that_share_the_parts_get_the_bits_of_one_alone(kind):
    parts = built(kind)

    def run(seed):
        return list(ticks(*parts, seed=seed))

    alone = [run(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, range(4)))
    for one, other in zip(arrays_in(alone), arrays_in(together), strict=True):
        np.testing.assert_array_equal(one, other)
