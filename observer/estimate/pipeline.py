"""Frames in, estimates out: the one path that the live service and a replay share."""

from __future__ import annotations

from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from observer.align.walk import OfFrame
from observer.estimators.by_block import BlockEstimator
from observer.estimators.live import LiveEstimator, LiveSelfTest
from observer.estimators.protocol import Estimator, EstimatorState
from observer.estimators.selftest import (
    Finding,
    SelfTest,
    SelfTestState,
    screening_findings,
    screening_history,
)
from observer.frames import EstimateBlock, FrameBlock, Inputs
from observer.kernels import record, step_frame
from observer.model.drive import Drive, DriveState
from observer.model.live import Frame, LiveDrive
from observer.quality.gap import GapState, GapWatch

States = tuple[DriveState, EstimatorState, SelfTestState | None]


class LiveStep(NamedTuple):
    """What the kernel takes, as records."""

    drive: Any
    estimator: Any
    test: Any


class Live:
    """Steps for the frames of one aligner."""

    def __init__(self, drive: Drive, estimator: BlockEstimator, test: SelfTest | None, of: OfFrame) -> None:
        """Allocate it for such frames."""
        self.of = of
        frame = Frame(of, of.channels, of.paths)
        self._drive = LiveDrive(drive, estimator.plant, frame)
        inputs, inputs_record = self._drive.inputs, self._drive.inputs_record
        self._estimator = LiveEstimator(estimator, inputs, inputs_record)
        self._test = None
        if test is not None:
            self._test = LiveSelfTest(test, frame.paths, inputs, inputs_record, self._estimator.results)
        test_record = None if self._test is None else self._test.record
        self._record = record(LiveStep(self._drive.record, self._estimator.record, test_record))
        self._fields = self._estimator.fields

    def step(self, data: bytes) -> EstimateBlock:
        """The estimate of the next frame; after an exception, where the parts stand is not known."""
        return EstimateBlock.of(self._fields, step_frame(self._record, data))

    @property
    def inputs(self) -> Inputs:
        """What drove the plant in the last step, for good."""
        return self._drive.keep_inputs()

    def keep(self) -> tuple[Any, Any, Any]:
        """Return where the parts stand, to be put back."""
        return self._drive.keep(), self._estimator.keep(), None if self._test is None else self._test.keep()

    def put_back(self, kept: tuple[Any, Any, Any]) -> None:
        """Have the parts stand where they stood."""
        self._drive.put_back(kept[0])
        self._estimator.put_back(kept[1])
        if self._test is not None:
            self._test.put_back(kept[2])

    @property
    def states(self) -> States:
        """Where the parts stand."""
        return self._drive.state, self._estimator.state, None if self._test is None else self._test.state

    def take(self, states: States) -> None:
        """Have the parts stand at these states."""
        self._drive.take(states[0])
        self._estimator.take(states[1])
        if self._test is not None and states[2] is not None:
            self._test.take(states[2])


def live_of(drive: Any, estimator: Any, test: SelfTest | None, of: OfFrame) -> Live | None:
    """The live parts for such frames; None where parts only know how to run over blocks."""
    if isinstance(drive, Drive) and isinstance(estimator, BlockEstimator):
        return Live(drive, estimator, test, of)
    return None


State = TypeVar("State")


class FrameDrive(Protocol[State]):
    """Turns frames into what drives the plant; holds no state of its own."""

    def initial(self) -> State:
        """Give the state before the first frame."""

    def run(self, state: State, frames: FrameBlock) -> tuple[State, Inputs]:
        """K steps; a run of K is, to the last bit, K runs of one."""


class Pipeline(Generic[State]):
    """Keeps the states of a drive, an estimator and its self-test from block to block.

    A single frame as it comes from the walk is stepped in place (see `Live`), by the same kernels. `gap`
    watches what the inputs predict, beside the estimator and without a word in it.
    """

    def __init__(
        self,
        drive: FrameDrive[State],
        estimator: Estimator,
        self_test: SelfTest | None = None,
        gap: GapWatch | None = None,
    ) -> None:
        """Begin before the first frame; without a self-test every quality is the estimator's own."""
        self._parts = drive, estimator, self_test
        self.gap = gap
        self._drive_state = drive.initial()
        self._estimator_state = estimator.initial()
        self._test_state = None if self_test is None else self_test.initial()
        self._live: Live | None = None
        self._is_live = self._is_ahead = False  # whether the live parts stand there too, or further on
        self._rests = False  # whether something of the last step is still to be done
        self._kept: Any = None
        self._inputs: Any = None

    def step(self, frames: FrameBlock) -> EstimateBlock:
        """The estimates of the next frames; an exception leaves the states as they were."""
        self._finish()
        try:
            of, data = frames.kept
        except AttributeError:  # not as the walk keeps a single one
            return self._run(frames)
        live = self._live
        if live is None or live.of is not of:
            live = self._another(of)
        if live is None:
            return self._run(frames)
        if not self._is_live:
            states: Any = (self._drive_state, self._estimator_state, self._test_state)
            live.take(states)
            self._is_live, self._kept = True, live.keep()
        try:
            estimates = live.step(data)
        except BaseException:
            live.put_back(self._kept)
            raise
        self._is_ahead = self._rests = True
        return estimates

    def _another(self, of: OfFrame) -> Live | None:
        """The live parts for another kind of frames."""
        self._settle()
        self._live, self._is_live = live_of(*self._parts, of), False
        return self._live

    def _run(self, frames: FrameBlock) -> EstimateBlock:
        """Step by a block."""
        self._settle()
        drive, estimator, test = self._parts
        test_state = self._test_state
        drive_state, inputs = drive.run(self._drive_state, frames)
        if test is not None and test_state is not None:
            test_state, motion, inputs = test.watch(test_state, frames, inputs)
        estimator_state, estimates = estimator.run(self._estimator_state, inputs)
        if test is not None and test_state is not None:
            test_state, estimates = test.run(test_state, motion, inputs, estimates)
        self._drive_state, self._estimator_state, self._test_state = drive_state, estimator_state, test_state
        self._take(inputs)
        self._is_live = False
        return estimates

    def _finish(self) -> None:
        """Do what can wait until an estimate is on its way."""
        if self._rests and self._live is not None:
            self._rests, self._kept = False, self._live.keep()
            self._take(self._live.inputs)

    def _settle(self) -> None:
        """Take over where the live parts stand."""
        self._finish()
        if self._is_ahead and self._live is not None:
            self._is_ahead, states = False, self._live.states
            self._drive_state, self._estimator_state, self._test_state = states  # type: ignore[assignment]

    def _take(self, inputs: Inputs) -> None:
        self._inputs = inputs
        if self.gap is not None:
            self.gap.take(inputs)

    @property
    def inputs(self) -> Inputs:
        """What drove the plant in the last block of frames."""
        self._finish()
        inputs: Inputs = self._inputs
        return inputs

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What self-test and screening find wrong now."""
        self._settle()
        test = self._parts[2]
        found = () if test is None or self._test_state is None else test.findings(self._test_state)
        return (*found, *screening_findings(self._parts[1].layout, self._estimator_state))

    @property
    def history(self) -> tuple[tuple[Finding, int], ...]:
        """What self-test and screening have ever found wrong, and in how many steps."""
        self._settle()
        test = self._parts[2]
        found = () if test is None or self._test_state is None else test.history(self._test_state)
        return (*found, *screening_history(self._parts[1].layout, self._estimator_state))

    def reset(self) -> None:
        """Have the estimator start afresh; what the drive remembers of the nut's path stays true."""
        self._settle()
        _, estimator, test = self._parts
        self._estimator_state = estimator.initial()
        self._test_state = None if test is None else test.initial()
        self._is_live = False
        if self.gap is not None:
            self.gap.reset()

    def snapshot(self) -> tuple[State, EstimatorState]:
        """Where drive and estimator stand; both are frozen."""
        self._settle()
        return self._drive_state, self._estimator_state

    def restore(self, drive: State, estimator: EstimatorState, gap: GapState | None = None) -> None:
        """Go on from where another pipeline of the same parts stood."""
        self._settle()
        self._drive_state, self._estimator_state = drive, estimator
        self._is_live = False
        if self.gap is not None and gap is not None:
            self.gap.restore(gap)
