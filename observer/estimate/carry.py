"""Where a service goes on from when the model of its screw has become another one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from observer.estimate.checkpoint import Snapshot
from observer.estimate.machine import Machine
from observer.estimators.carry import taken, told
from observer.estimators.protocol import Estimator
from observer.frames import EstimateBlock, FrameBlock, Inputs
from observer.model.drive import DriveState


@dataclass(frozen=True, slots=True)
class LastStep:
    """What a service took in and gave out at its last tick; blocks of one."""

    frame: FrameBlock
    inputs: Inputs
    estimate: EstimateBlock


def carried_over(
    snapshot: Snapshot | None, last: LastStep | None, before: Machine, now: Machine, estimator: Estimator
) -> Snapshot | None:
    """A snapshot for another model of the same screw: its field and heats with their σ.

    What had been learnt of the old model begins anew, and so do the watch over its gap and all that counts
    from a start. None where
    nothing was known yet, or where the two have nothing to say to each other.
    """
    if snapshot is None or last is None or not set(now.config.channels) <= set(last.frame.channels):
        return None
    known = told(before.plant, snapshot.estimator, last.inputs, last.estimate)
    if known is None:
        return None
    drive_state, inputs = now.drive.run(now.drive.initial(), last.frame)
    state = taken(now.plant, estimator, known, inputs)
    if state is None or not (np.isfinite(state.x_hat).all() and np.isfinite(state.P).all()):
        return None
    return replace(snapshot, drive=_with_paths(drive_state, snapshot.drive), estimator=state, gap=None)


def _with_paths(drive: DriveState, before: DriveState) -> DriveState:
    """What is remembered of nuts' paths, where the nuts are the same and the states as many."""
    if [len(nut.B) for nut in drive.nuts] != [len(nut.B) for nut in before.nuts]:
        return drive
    return replace(drive, nuts=before.nuts, turns=before.turns)
