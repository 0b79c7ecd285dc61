"""Field and heats go on in another model of the screw, with what is known of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from observer.align.aligner import blocks_of_log
from observer.estimate.checkpoint import CheckpointFit, Snapshot, UnfitError, pack, unpack
from observer.estimate.pipeline import MachineModel
from observer.estimate.screw_state import ScrewState
from observer.estimators.protocol import Estimator
from observer.files.logs import read_log
from observer.files.regular import read_toml
from observer.frames import EstimateBlock, FrameBlock
from observer.installation import parse
from observer.service.observers import Step
from tests.logs.machines import RIG

TABLE = read_toml(RIG / "config.toml")
AFTER = 5000
"""Steps of the rig's log, after which the heats are known to some 2 W of 14 to 42."""
OFTEN_K = 0.3
"""How far two models may be apart in the field at one moment: a third of the largest σ here."""


class Stood(NamedTuple):
    """Where a service stood, and the frames that come then."""

    machine: MachineModel
    snapshot: Snapshot
    last: Step
    then: list[FrameBlock]


def _parts(**changes: Any) -> tuple[MachineModel, Estimator]:
    machine = MachineModel.of(parse(TABLE | changes), learns=True)
    return machine, machine.estimator()


@cache
def _stood() -> Stood:
    machine, estimator = _parts()
    pipeline = machine.pipeline(estimator)
    log = read_log(RIG / "run_c.csv.gz", machine.config.channels)
    pipeline.step(next(iter(blocks_of_log(log, machine.plan, block=AFTER - 1)))[0])
    frames = [block for block, _ in blocks_of_log(log, machine.plan, block=1)][: AFTER + 100]
    frame = frames[AFTER - 1]
    estimate = pipeline.step(frame)
    last = Step(frame, pipeline.inputs, estimate)
    return Stood(machine, Snapshot(float(frame.time_s[0]), *pipeline.snapshot()), last, frames[AFTER:])


def _carried(stood: Stood, other: MachineModel) -> Snapshot | None:
    """What another model continues from after a restart; None where it starts cold."""
    screw = ScrewState.of(
        stood.machine, stood.snapshot.estimator, stood.last.inputs, stood.last.estimate, stood.last.frame
    )
    data = pack(replace(stood.snapshot, screw=screw), replace(CheckpointFit.of(stood.machine), plant="old"))
    try:
        return unpack(data, CheckpointFit.of(other), other)
    except UnfitError:
        return None


def _next(
    machine: MachineModel, estimator: Estimator, snapshot: Snapshot, frames: list[FrameBlock]
) -> EstimateBlock:
    pipeline = machine.pipeline(estimator)
    pipeline.restore(snapshot.drive, snapshot.estimator)
    for frame in frames:
        estimate = pipeline.step(frame)
    return estimate


def _effect(kind: str, **keys: Any) -> dict[str, Any]:
    return {"effect": [{"kind": kind, **keys}]}


@pytest.mark.parametrize(
    "changes",
    [
        _effect("end_conduction", target="left", conductance_W_K=0.1),
        _effect("attached_mass", target="right", capacity_J_K=500.0, conductance_W_K=2.0),
        _effect("sensor_lag", target="t2", time_constant_s=30.0),
        _effect("friction_fade", target="nut", per_K=0.01),
        {"source": [source | {"scale": 1.3} for source in TABLE["source"]]},
        {"surface": TABLE["surface"] | {"convection_W_m2K": 25.0}},
        {"screw": TABLE["screw"] | {"conductivity_W_mK": 45.0}},
        {"model": {"modes": 12}},
        {"tolerance": {"convection": 0.0, "conductivity": 0.0, "heat_capacity": 0.0, "offset_K": 0.0,
                       "ambient_K": 0.0, "position_m": 0.0, "lag_s": 0.0}},
    ],
    ids=["end", "mass", "lag", "fade", "laws", "film", "conductivity", "modes", "tolerances"],
)  # fmt: skip
def test_the_next_estimate_continues_from_the_last(changes):
    """A cold start would know the heats to 30 W, and begin at their laws."""
    _, _, last, then = _stood()
    other, estimator = _parts(**changes)
    there = _carried(_stood(), other)
    before, after = last.estimate, _next(other, estimator, there, then[:1])
    moved = np.abs(after.heat_W - before.heat_W) / before.heat_sigma_W
    assert moved.max() < 0.25
    np.testing.assert_allclose(after.heat_sigma_W, before.heat_sigma_W, rtol=0.1)
    assert np.abs(after.field_degC - before.field_degC).max() < OFTEN_K
    assert (np.abs(after.innovation_K) < 4.0 * after.innovation_sigma_K)[~np.isnan(after.innovation_K)].all()
    lowest = np.linalg.eigvalsh(there.estimator.P).min()
    assert lowest > -1e-9 * np.abs(there.estimator.P).max()


def test_an_estimate_carried_into_the_same_model_is_nearly_the_same_fifty_seconds_on():
    """Not the same, since what had been learnt begins anew; a cold start would be off by 5 W, two σ."""
    machine, snapshot, _, then = _stood()
    other, estimator = _parts()
    there = _carried(_stood(), other)
    stayed = _next(machine, estimator, snapshot, then)
    after = _next(other, estimator, there, then)
    assert (np.abs(after.heat_W - stayed.heat_W) / stayed.heat_sigma_W).max() < 1.0
    np.testing.assert_allclose(after.heat_sigma_W, stayed.heat_sigma_W, rtol=0.1)


def test_parameters_learnt_of_the_old_model_start_again():
    _, _, last, then = _stood()
    other, estimator = _parts(**_effect("end_conduction", target="left", conductance_W_K=0.1))
    there = _carried(_stood(), other)
    film = other.plant.layout.learned.index("surface.convection_W_m2K")
    cold = _next(other, estimator, replace(there, estimator=estimator.initial()), then[:1])
    after = _next(other, estimator, there, then[:1])
    assert last.estimate.learned_sigma[0, film] < 0.95 * cold.learned_sigma[0, film]
    np.testing.assert_allclose(after.learned_sigma[0, film], cold.learned_sigma[0, film], rtol=0.02)


def test_without_anything_in_common_it_starts_cold():
    elsewhere = {"output": {"positions_m": [0.0, 0.5]}}
    renamed = {"source": [source | {"name": f"new-{i}"} for i, source in enumerate(TABLE["source"])]}
    more = {"ambient": {"channel": "another_degC"}}
    for changes in (elsewhere, renamed, more):
        assert _carried(_stood(), _parts(**changes)[0]) is None
    snapshot = _stood().snapshot
    unknown = replace(snapshot, estimator=replace(snapshot.estimator, started=False))
    assert _carried(_stood()._replace(snapshot=unknown), _parts()[0]) is None


class _StatesOfItsOwn:
    """An estimator without `at`, as from another package."""

    def __init__(self, estimator: Estimator) -> None:
        self.layout, self.initial, self.run = estimator.layout, estimator.initial, estimator.run


@pytest.mark.parametrize("of", ["before", "now"])
def test_a_service_starts_cold_beside_an_estimator_with_states_of_its_own(of):
    other, estimator = _parts()
    assert _carried(_stood(), other) is not None
    own = MachineModel(other.config, other.plant, other.drive, other.plan)
    own.__dict__["_estimator"] = _StatesOfItsOwn(estimator)
    before, now = (own, other) if of == "before" else (_stood().machine, own)
    assert _carried(_stood()._replace(machine=before), now) is None


@pytest.mark.parametrize(
    "spoilt", [{"position_m": []}, {"heats": 3}, {"values": ["<f8", [1, 10**9], b""]}, {"value": np.zeros(2)}]
)
def test_a_state_of_a_screw_that_is_damaged_is_a_cold_start(spoilt):
    _, snapshot, last, _ = _stood()
    machine = _stood().machine
    screw = ScrewState.of(machine, snapshot.estimator, last.inputs, last.estimate, last.frame)
    plain = {name: getattr(screw, name) for name in ScrewState.__dataclass_fields__} | spoilt
    data = pack(replace(snapshot, screw=plain), replace(CheckpointFit.of(machine), plant="old"))
    other, _ = _parts()
    with pytest.raises(UnfitError):
        unpack(data, CheckpointFit.of(other), other)
