"""Drive, estimator and self-test for one frame after the other, on memory that lives as long as they do.

The kernels are those of whole blocks, so the bits are; what is handed out is a copy that nobody writes to.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from observer.align.walk import OfFrame
from observer.estimators.by_block import BlockEstimator
from observer.estimators.live import LiveEstimator, LiveSelfTest
from observer.estimators.protocol import EstimatorState
from observer.estimators.selftest import SelfTest, SelfTestState
from observer.frames import EstimateBlock, Inputs
from observer.kernels import record, step_frame
from observer.model.drive import Drive, DriveState
from observer.model.live import Frame, LiveDrive

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
