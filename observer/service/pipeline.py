"""Frames in, estimates out: the one path that the live service and a replay share."""

from __future__ import annotations

from typing import Generic, Protocol, TypeVar

from observer.estimators.protocol import Estimator, EstimatorState
from observer.estimators.selftest import Finding, SelfTest
from observer.frames import EstimateBlock, FrameBlock, Inputs
from observer.service.gap import GapWatch

DriveState = TypeVar("DriveState")


class Drive(Protocol[DriveState]):
    """Turns frames into what drives the plant; holds no state of its own."""

    def initial(self) -> DriveState:
        """Give the state before the first frame."""

    def run(self, state: DriveState, frames: FrameBlock) -> tuple[DriveState, Inputs]:
        """K steps; a run of K is, to the last bit, K runs of one."""


class Pipeline(Generic[DriveState]):
    """Keeps the states of a drive, an estimator and its self-test from block to block.

    `inputs` are what drove the plant in the last of them; `gap` watches what they predict, beside the
    estimator and without a word in it.
    """

    inputs: Inputs

    def __init__(
        self,
        drive: Drive[DriveState],
        estimator: Estimator,
        self_test: SelfTest | None = None,
        gap: GapWatch | None = None,
    ) -> None:
        """Begin before the first frame; without a self-test every quality is the estimator's own."""
        self._drive = drive
        self._estimator = estimator
        self._self_test = self_test
        self.gap = gap
        self._drive_state = drive.initial()
        self._estimator_state = estimator.initial()
        self._test_state = None if self_test is None else self_test.initial()

    def step(self, frames: FrameBlock) -> EstimateBlock:
        """The estimates of the next frames; an exception leaves the states as they were."""
        drive_state, inputs = self._drive.run(self._drive_state, frames)
        test, test_state = self._self_test, self._test_state
        if test is not None and test_state is not None:
            test_state, motion, inputs = test.watch(test_state, frames, inputs)
        estimator_state, estimates = self._estimator.run(self._estimator_state, inputs)
        if test is not None and test_state is not None:
            test_state, estimates = test.run(test_state, motion, inputs, estimates)
        self._drive_state, self._estimator_state, self._test_state = drive_state, estimator_state, test_state
        self.inputs = inputs
        if self.gap is not None:
            self.gap.take(inputs)
        return estimates

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the self-test finds wrong now."""
        if self._self_test is None or self._test_state is None:
            return ()
        return self._self_test.findings(self._test_state)

    @property
    def history(self) -> tuple[tuple[Finding, int], ...]:
        """What the self-test has ever found wrong, and in how many steps."""
        if self._self_test is None or self._test_state is None:
            return ()
        return self._self_test.history(self._test_state)

    def reset(self) -> None:
        """Have the estimator start afresh; what the drive remembers of the nut's path stays true."""
        self._estimator_state = self._estimator.initial()
        self._test_state = None if self._self_test is None else self._self_test.initial()
        if self.gap is not None:
            self.gap.reset()

    def snapshot(self) -> tuple[DriveState, EstimatorState]:
        """Where drive and estimator stand; both are frozen."""
        return self._drive_state, self._estimator_state

    def restore(self, drive: DriveState, estimator: EstimatorState) -> None:
        """Go on from where another pipeline of the same parts stood."""
        self._drive_state, self._estimator_state = drive, estimator
