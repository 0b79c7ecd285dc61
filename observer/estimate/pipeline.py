"""Frames in, estimates out: the one path shared by the live service and a replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from observer.align.aligner import AlignPlan
from observer.align.walk import OfFrame
from observer.config.machine import Config
from observer.errors import ConfigError
from observer.estimate.shown import ShownHeats
from observer.estimators import build_estimator
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
from observer.estimators.tolerant import Tolerant
from observer.frames import EstimateBlock, FrameBlock, Inputs, Layout, Quality
from observer.kernels import record, step_frame
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.live import Frame, LiveDrive
from observer.model.plant import Plant
from observer.model.realise import realise
from observer.quality.gap import GapState, GapWatch


class LiveStep(NamedTuple):
    """The data of a step for the kernel, as records."""

    drive: Any
    estimator: Any
    test: Any


class Live:
    """Steps for the frames of one aligner, in memory that is allocated once.

    Attributes:
        of: The memory layout of the frames that it takes.
        parts: Drive, estimator and, if there is one, self-test; their states have the same order.
    """

    def __init__(self, drive: Drive, estimator: BlockEstimator, test: SelfTest | None, of: OfFrame) -> None:
        """Allocate it for the frames of one walk.

        Args:
            drive: Turns frames into inputs.
            estimator: An estimator of blocks.
            test: The self-test; None without.
            of: The layout of the frames.
        """
        self.of = of
        frame = Frame(of, of.channels, of.paths)
        self._drive = LiveDrive(drive, estimator.plant, frame)
        inputs, inputs_record = self._drive.inputs, self._drive.inputs_record
        live_estimator = LiveEstimator(estimator, inputs, inputs_record)
        self.parts: list[Any] = [self._drive, live_estimator]
        if test is not None:
            self.parts.append(LiveSelfTest(test, frame.paths, inputs, inputs_record, live_estimator.results))
        records = [part.record for part in self.parts]
        self._record = record(LiveStep(*records, *[None] * (3 - len(records))))
        self._fields = live_estimator.fields

    def step(self, data: bytes) -> EstimateBlock:
        """Return the estimate of the next frame.

        After an exception the state of the parts is unknown.

        Args:
            data: The bytes of a frame with the layout `of`.
        """
        return EstimateBlock.of(self._fields, step_frame(self._record, data))

    @property
    def inputs(self) -> Inputs:
        """A copy of the inputs of the last step."""
        return self._drive.keep_inputs()


State = TypeVar("State")


class FrameDrive(Protocol[State]):
    """Turns frames into inputs of the plant; stateless."""

    def initial(self) -> State:
        """Return the state before the first frame."""

    def run(self, state: State, frames: FrameBlock) -> tuple[State, Inputs]:
        """Take K steps; a run of K is, to the last bit, K runs of one.

        Args:
            state: The state before the first of them; it is not changed.
            frames: K frames.

        Returns:
            The state after the last one, and the inputs of the K steps.
        """


class Pipeline(Generic[State]):
    """Keeps the states of a drive, an estimator and its self-test from block to block.

    A single frame from the walk is stepped in place (see `Live`), by the same kernels. The monitor `gap`
    compares readings with an open-loop prediction, without influence on the estimator.

    Blocks of any length give the same estimates to the last bit. It belongs to one thread.

    Attributes:
        gap: The monitor of the open-loop residual; None without.
    """

    def __init__(
        self,
        drive: FrameDrive[State],
        estimator: Estimator,
        self_test: SelfTest | None = None,
        gap: GapWatch | None = None,
        shown: ShownHeats | None = None,
        occasional: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        """Begin before the first frame.

        Args:
            drive: Turns frames into inputs.
            estimator: Turns inputs into estimates.
            self_test: Lowers the quality of doubtful estimates; without it every quality is that of the
                estimator.
            gap: The monitor of the open-loop residual; None without.
            shown: The heats that estimates show; None shows the estimated ones.
            occasional: The channels of sensors that are read only occasionally, by the sensors' numbers.
        """
        self._drive, self._estimator, self._test, self.gap = drive, estimator, self_test, gap
        self._shown, self._occasional = shown, occasional
        self._states: list[Any] = [drive.initial(), *self._begin()]
        self._past: tuple[tuple[Finding, int], ...] = ()
        self._live: Live | None = None
        self._is_live = False  # whether the live parts are in that state too, or a step ahead of it
        self._rests = False  # whether they are ahead, and something of that step is still to be done
        self._inputs: Any = None

    @property
    def layout(self) -> Layout:
        """The columns of the estimates."""
        layout = self._estimator.layout
        return layout if self._shown is None else self._shown.layout(layout)

    def _begin(self) -> list[Any]:
        """Return the states of estimator and self-test before the first step."""
        return [self._estimator.initial(), *([] if self._test is None else [self._test.initial()])]

    def step(self, frames: FrameBlock) -> EstimateBlock:
        """Return the estimates of the next frames; an exception leaves the states unchanged.

        Args:
            frames: K frames, later than all before.

        Returns:
            K estimates, with the shown heats and their quality.
        """
        estimates = self._estimates(frames)
        if self._occasional:
            estimates = _never_read(frames, estimates, self._occasional)
        return estimates if self._shown is None else self._shown.block(estimates)

    def _estimates(self, frames: FrameBlock) -> EstimateBlock:
        """Return the estimates of the next frames with the estimator's heats only."""
        self._finish()
        live, data = self._live_of(frames)
        if live is None:
            return self._run(frames)
        if not self._is_live:
            for part, state in zip(live.parts, self._states, strict=True):
                part.take(state)
        self._is_live = False  # in a step that fails
        estimates = live.step(data)
        self._is_live = self._rests = True
        return estimates

    def _live_of(self, frames: FrameBlock) -> tuple[Live | None, bytes]:
        """Return the live parts and the data of a single frame; None for parts or frames that need blocks."""
        of, data = getattr(frames, "kept", (None, b""))
        drive: Any = self._drive
        if not (of and isinstance(drive, Drive) and isinstance(self._estimator, BlockEstimator)):
            return None, data
        if self._live is None or self._live.of is not of:
            self._live, self._is_live = Live(drive, self._estimator, self._test, of), False
        return self._live, data

    def _run(self, frames: FrameBlock) -> EstimateBlock:
        """Step by a block."""
        test, (drive_state, state, *test_states) = self._test, self._states
        drive_state, inputs = self._drive.run(drive_state, frames)
        if test is None:
            state, estimates = self._estimator.run(state, inputs)
        else:
            (test_state,) = test_states
            test_state, motion, inputs = test.watch(test_state, frames, inputs)
            state, estimates = self._estimator.run(state, inputs)
            test_state, estimates = test.run(test_state, motion, inputs, estimates)
            test_states = [test_state]
        self._states, self._is_live = [drive_state, state, *test_states], False
        self._take(inputs)
        return estimates

    def _finish(self) -> None:
        """Do the work that can wait until an estimate has been sent: copy the states, and watch the gap."""
        if self._rests and self._live is not None:
            self._rests, self._states = False, [part.state for part in self._live.parts]
            self._take(self._live.inputs)

    def _take(self, inputs: Inputs) -> None:
        self._inputs = inputs
        if self.gap is not None:
            self.gap.take(inputs)

    @property
    def inputs(self) -> Inputs:
        """The inputs of the plant in the last block of frames."""
        self._finish()
        inputs: Inputs = self._inputs
        return inputs

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The present findings of self-test and screening."""
        self._finish()
        test_findings = () if self._test is None else self._test.findings(self._states[2])
        return (*test_findings, *screening_findings(self._estimator.layout, self._states[1]))

    @property
    def history(self) -> tuple[tuple[Finding, int], ...]:
        """All findings of self-test and screening so far, with their numbers of steps."""
        self._finish()
        test_history = () if self._test is None else self._test.history(self._states[2])
        return (*self._past, *test_history, *screening_history(self._estimator.layout, self._states[1]))

    def reset(self) -> None:
        """Restart the estimator and the self-test; the drive's memory of the nut's path stays."""
        self._past = self.history
        self._states[1:], self._is_live = self._begin(), False
        if self.gap is not None:
            self.gap.reset()

    def snapshot(self) -> tuple[State, EstimatorState, GapState | None]:
        """Return copies of the states of drive and estimator, and the state of the open-loop residual.

        The last is None without that monitor.
        """
        self._finish()
        return self._states[0], self._states[1], None if self.gap is None else self.gap.state

    @property
    def test_state(self) -> SelfTestState | None:
        """The state of the self-test, None without one."""
        self._finish()
        return None if self._test is None else self._states[2]

    def restore(
        self,
        drive: State,
        estimator: EstimatorState,
        gap: GapState | None = None,
        test: SelfTestState | None = None,
    ) -> None:
        """Continue from the state of another pipeline of the same parts.

        Args:
            drive: The state of the drive.
            estimator: The state of the estimator.
            gap: The state of the open-loop residual; None leaves it as it is.
            test: The state of the self-test; None leaves it as it is.
        """
        self._finish()
        self._states[:2], self._is_live = [drive, estimator], False
        if self._test is not None and test is not None:
            self._states[2] = test
        if self.gap is not None and gap is not None:
            self.gap.restore(gap)


def _never_read(frames: FrameBlock, estimates: EstimateBlock, occasional: Mapping[int, str]) -> EstimateBlock:
    """Return estimates in which the quality of an occasional sensor is missing until its first value."""
    channel_quality = frames.shown_quality[
        :, [frames.channels.index(channel) for channel in occasional.values()]
    ]
    sensor_quality = estimates.sensor_quality[:, list(occasional)]
    never = (channel_quality == Quality.MISSING) & (sensor_quality == Quality.GOOD)
    if not never.any():
        return estimates
    shown = estimates.sensor_quality.copy()
    shown[:, list(occasional)] = np.where(never, np.int8(Quality.MISSING), sensor_quality)
    return replace(estimates, sensor_quality=shown)


@dataclass(frozen=True)
class MachineModel:
    """A configuration with the plant, the drive and the expectations of its channels that follow from it.

    Each part is built once; all parts are stateless, so several pipelines may share them.

    Attributes:
        config: The configuration.
        plant: Its plant.
        drive: Turns frames into inputs of the plant.
        plan: How each channel is expected to deliver its values.
    """

    config: Config
    plant: Plant
    drive: Drive
    plan: AlignPlan

    @classmethod
    def of(cls, config: Config, *, learns: bool = False) -> MachineModel:
        """Build the parts of a configuration.

        Args:
            config: A checked configuration.
            learns: Whether the plant includes learnt and considered parameters, where the estimator allows
                them.

        Raises:
            ConfigError: If no plant can be built of it.
        """
        plant = build_plant(config, learns=learns and config.estimator.allows)
        return cls(config, plant, Drive(config, plant), AlignPlan.of(config))

    @cached_property
    def shown(self) -> ShownHeats:
        """The shown heats and their columns in the estimate."""
        return ShownHeats.of(self.plant)

    @cached_property
    def occasional(self) -> Mapping[int, str]:
        """The channels of sensors that are read only occasionally, by the sensors' numbers."""
        return {i: s.channel for i, s in enumerate(self.config.sensor) if s.occasional}

    @property
    def layout(self) -> Layout:
        """The columns of the shown estimates."""
        return self.shown.layout(self.plant.layout)

    @cached_property
    def with_law(self) -> frozenset[str]:
        """The names of the sources whose heat has a law."""
        return frozenset(s.name for s in realise(self.config).config.source if s.law is not None)

    @cached_property
    def _tolerant(self) -> Tolerant | None:
        free = (
            n for n, is_free in zip(self.plant.source_names, self.plant.estimated, strict=True) if is_free
        )
        if not self.with_law.issuperset(free):
            return None
        return Tolerant(
            self.plant if self.plant.learning is not None else build_plant(self.config, learns=True)
        )

    @cached_property
    def _estimator(self) -> Estimator:
        integrity = self.config.integrity
        return build_estimator(self.plant, self.config.estimator, integrity if integrity.enabled else None)

    def estimator(self) -> Estimator:
        """Return the estimator, designed at the first call.

        Raises:
            UserError: If no reliable gain exists; it names the sensors and the remedy.
        """
        return self._estimator

    def self_test(self) -> SelfTest:
        """Return a new self-test, which compares the estimates with the model and the laws."""
        return SelfTest(self.plant, self.with_law)

    def gap(self) -> GapWatch | None:
        """Return a new monitor of the open-loop residual; None if a heat lacks a law."""
        return None if self._tolerant is None else GapWatch(self._tolerant, self.plant.layout.sensors)

    def pipeline(self, estimator: Estimator | None = None) -> Pipeline[Any]:
        """Return a new pipeline from frames to estimates with their quality.

        Args:
            estimator: Replaces the configured one; None takes that.

        Raises:
            ConfigError: If a displacement is a nonlinear function of the state.
            UserError: If no reliable gain exists.
        """
        restraint, moved = self.plant.rows.restraint, self.plant.layout.displacements
        if moved and restraint is not None and not restraint.linear:
            raise ConfigError(
                f"sensor {moved[0]}: with supports.gap_m a displacement bends where the play closes, which "
                "no estimator here can follow; calibrate with it, but remove sensor or play to estimate"
            )
        return Pipeline(
            self.drive,
            estimator or self.estimator(),
            self.self_test(),
            self.gap(),
            self.shown,
            self.occasional,
        )
