"""The advice to probe now: given when the error is known worse than the part needs, with what it is worth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.machine import Config
from observer.config.publishing import Publish
from observer.estimate.checkpoint import Snapshot
from observer.estimate.pipeline import MachineModel
from observer.estimators.design.probing import probing_worth
from observer.service.observers import Step
from observer.service.probing import ProbingAdvisor, is_advised
from tests.model.test_displacement import OCCASIONAL, log_of, probed, with_readings

THERE = 15  # of the grid, where the probe is


def stepped(config: Config, probing_rows: int) -> tuple[MachineModel, Any, list[Any]]:
    """A machine at work with a probing every so many rows, and its blocks, one a row."""
    machine = MachineModel.of(config, learns=True)
    pipeline = machine.pipeline()
    pipeline.gap = None
    log = with_readings(config, log_of(config), probing_rows)
    blocks = [pipeline.step(frames) for frames in frames_of_log(log, AlignPlan.of(config), block=1)]
    return machine, pipeline, blocks


def test_the_worth_of_a_probing_is_what_its_reading_leaves() -> None:
    config = probed(sensor=OCCASIONAL, integrity={"enabled": False})
    machine = MachineModel.of(config, learns=True)
    pipeline = machine.pipeline()
    pipeline.gap = None
    log = with_readings(config, log_of(config), 300)
    before: Any = None
    for k, frames in enumerate(frames_of_log(log, AlignPlan.of(config), block=1)):
        block = pipeline.step(frames)
        if k == 298:
            before = probing_worth(machine.plant, pipeline._states[1].P, 3)
            np.testing.assert_allclose(before.before_um, block.error_sigma_um[0], rtol=0.02, atol=1e-3)
        if k == 299:  # with it come the thermocouples, which say little more, and a step's noise
            np.testing.assert_allclose(before.after_um[THERE], block.error_sigma_um[0, THERE], rtol=0.1)
    assert before.after_um[THERE] < 0.7 * before.before_um[THERE]


@pytest.mark.parametrize(("needs_um", "now"), [(0.5, True), (500.0, False)])
def test_a_probing_is_advised_when_the_part_needs_it(needs_um: float, now: bool) -> None:
    config = probed(sensor=OCCASIONAL, probing={"needs_um": needs_um})
    machine, pipeline, blocks = stepped(config, 10_000)
    said: list[Any] = []
    advisor = ProbingAdvisor(config, machine.plant, "one", said.append)
    state = pipeline._states[1]
    for now_s in (0.0, 2.0, 5.0):
        snapshot = Snapshot(now_s, None, state)
        advisor.follow(Step(None, None, blocks[-1], 7, now_s, 0.0, lambda s=snapshot: s))  # type: ignore[arg-type,misc]
    assert len(said) == 2  # every five seconds
    assert said[0]["probe_now"] is now
    assert said[0]["within_um"] == pytest.approx(np.max(blocks[-1].error_bound_um), abs=1e-3)
    assert said[0]["after_um"] < said[0]["within_um"]
    assert (said[0]["sensor"], said[0]["instance"], said[0]["sequence"]) == ("probe", "one", 7)
    publisher = ZenohPublisher(
        ServiceIdentity("m", "x", "one"), Publish(), "{}", machine.plant.layout, offers=["probing"]
    )
    publisher.document("probing", said[0])  # the key is there


def test_nothing_is_advised_where_nothing_is_asked() -> None:
    assert not is_advised(probed(sensor=OCCASIONAL))
    assert is_advised(probed(sensor=OCCASIONAL, integrity={"limit_um": 5.0}))
