"""Frames in, estimates out: the one path that the live service and a replay share."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

from observer.estimators.protocol import Estimator, EstimatorState
from observer.frames import EstimateBlock, FrameBlock, Inputs

DriveState = TypeVar("DriveState")


class Drive(Protocol[DriveState]):
    """Turns frames into what drives the plant; holds no state of its own."""

    def initial(self) -> DriveState:
        """Give the state before the first frame."""

    def run(self, state: DriveState, frames: FrameBlock) -> tuple[DriveState, Inputs]:
        """K steps; a run of K is, to the last bit, K runs of one."""


class Pipeline(Generic[DriveState]):
    """Keeps the states of a drive and an estimator from block to block."""

    def __init__(self, drive: Drive[DriveState], estimator: Estimator) -> None:
        self._drive = drive
        self._estimator = estimator
        self._drive_state = drive.initial()
        self._estimator_state = estimator.initial()

    def step(self, frames: FrameBlock) -> EstimateBlock:
        """The estimates of the next frames; an exception leaves the states as they were."""
        drive_state, inputs = self._drive.run(self._drive_state, frames)
        self._estimator_state, estimates = self._estimator.run(self._estimator_state, inputs)
        self._drive_state = drive_state
        return estimates

    def snapshot(self) -> tuple[DriveState, EstimatorState]:
        """Where drive and estimator stand; both are frozen."""
        return self._drive_state, self._estimator_state

    def restore(self, drive: DriveState, estimator: EstimatorState) -> None:
        """Go on from where another pipeline of the same parts stood."""
        self._drive_state, self._estimator_state = drive, estimator

    def warm_up(self, frames: FrameBlock) -> None:
        """Have everything compiled and loaded, by steps that are then forgotten."""
        _, inputs = self._drive.run(self._drive.initial(), frames)
        self._estimator.run(self._estimator.initial(), inputs)
