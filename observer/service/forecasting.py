"""The forecast beside the loop: it learns the program from each step, and computes in a thread of its own."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import structlog

from observer.align.aligner import frames_of_log
from observer.errors import LogError
from observer.estimate.checkpoint import Snapshot
from observer.estimate.pipeline import MachineModel
from observer.estimators.protocol import EstimatorState
from observer.files.logs import Log
from observer.forecast.ahead import runner
from observer.forecast.document import Forecast, document, forecast, no_forecast
from observer.forecast.program import Bins, binned, joined, learnt
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, Inputs, Layout
from observer.service.observers import Step, StepObserver

_ESTIMATED = ("heat_W", "sigma_W", "own_law_W")
_GATHER_S = 20.0
_LOOK_S = 1.0
_MOST_STEPS = 200_000
log = structlog.get_logger()


class Learner:
    """Gathers what drove a plant, and the heats, in bins.

    Args:
        machine: The machine, whose moving sources and shown heats are gathered.
    """

    def __init__(self, machine: MachineModel) -> None:
        self._moving, self._shown = [m.index for m in machine.plant.moving], machine.shown
        self._parts: Bins | None = None

    def take(self, inputs: Inputs, block: EstimateBlock) -> None:
        """Take consecutive steps.

        Args:
            inputs: The inputs of K steps.
            block: Their estimates, of the same K steps.
        """
        bins = binned(inputs, self._shown.estimated(block), self._moving)
        self._parts = bins if self._parts is None else joined([self._parts, bins])

    @property
    def bins(self) -> Bins:
        """The bins of the steps so far; old ones fall out.

        Raises:
            ValueError: Before the first step.
        """
        if self._parts is None:
            raise ValueError("the program is not known yet; wait for a minute of operation")
        return self._parts


def is_wanted(machine: MachineModel) -> bool:
    """Whether a forecast is computed.

    The key `forecast.enabled` decides. Without it a forecast is computed if every estimated heat has a law.
    """
    is_enabled = machine.config.forecast.enabled
    return (machine.gap() is not None) if is_enabled is None else is_enabled


class Forecaster(StepObserver):
    """Computes forecasts periodically from the newest state; no method waits for it.

    A forecast that fails is logged and left out. Its document then has the reason in place of values.

    Steps that the thread has not gathered yet are held in memory, 200 000 at most.
    """

    def __init__(
        self, machine: MachineModel, instance: str, publish: Callable[[Mapping[str, Any]], None]
    ) -> None:
        """Prepare; nothing runs before `begin`.

        Args:
            machine: The machine with its plant and configuration.
            instance: Names the start of the service, in every document.
            publish: Called in the forecaster's own thread with each document.
        """
        self._machine, self._instance, self._publish = machine, instance, publish
        self._settings = machine.config.forecast
        self._learner = Learner(machine)
        self._steps: deque[Step] = deque(maxlen=_MOST_STEPS)
        self._newest: EstimatorState | None = None
        self._looked_s = -math.inf
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="forecast", daemon=True)

    def begin(self) -> None:
        """Start its thread; returns at once."""
        self._thread.start()

    def follow(self, step: Step) -> None:
        """Take a step of the loop, all of it frozen, and once a second the estimator's state."""
        if step.now_s - self._looked_s >= _LOOK_S:
            self._looked_s, snapshot = step.now_s, step.snapshot()
            self._newest = None if snapshot is None else snapshot.estimator
        self._steps.append(step)

    def finish(self, _snapshot: Snapshot | None) -> None:
        """Publish no more; what is being computed is dropped with its thread."""
        self._closing.set()

    def _run(self) -> None:
        waited_s, period_s = 0.0, self._settings.period_s
        pause_s = min(_GATHER_S, period_s)
        while not self._closing.wait(pause_s):
            waited_s += pause_s
            try:
                last = self._gather()
                if last is not None and waited_s >= period_s:
                    waited_s = 0.0
                    message = self._document(last)
                    if not self._closing.is_set():
                        self._publish(message)
            except Exception:  # a forecast is an extra: the service continues without
                log.error("the forecast failed", exc_info=True)

    def _gather(self) -> EstimateBlock | None:
        steps = [self._steps.popleft() for _ in range(len(self._steps))]
        if not steps:
            return None
        inputs = Inputs.joined([step.inputs for step in steps])
        self._learner.take(inputs, EstimateBlock.joined([step.estimate for step in steps]))
        return steps[-1].estimate

    def _document(self, last: EstimateBlock) -> dict[str, Any]:
        state, quality = self._newest, EstimateQuality(int(last.quality[-1]))
        within_um, plant = self._settings.within_um, self._machine.plant
        try:
            if state is None or not state.started:
                raise ValueError("there is no estimate yet; wait until `observer health` shows one")
            program = learnt(self._learner.bins)
            begins = [(1.0, runner(plant, self._machine.config.estimator, state, program))]
            prediction = forecast(self._machine.config, begins, program, self._settings.hours, within_um)
        except ValueError as error:
            worse = max(quality, EstimateQuality.STARTING)
            return no_forecast(float(last.time_s[-1]), worse, self._instance, str(error), within_um)
        return document(prediction, plant, quality, self._instance, within_um)


def program_bins(program: Log, machine: MachineModel) -> Bins:
    """Return the bins of a program (see `program_of`).

    Args:
        program: A log with every input that the model needs.
        machine: The machine that is to run it.

    Returns:
        Bins of the estimated sources, in the order of the program.

    Raises:
        LogError: If an input never has a value.
    """
    moving, state, parts = [m.index for m in machine.plant.moving], machine.drive.initial(), []
    for frames in frames_of_log(program, machine.plan):
        state, inputs = machine.drive.run(state, frames)
        bins = binned(inputs, None, moving)
        if len(bins.dt_s):
            free = machine.plant.estimated
            parts.append(bins._replace(**{n: getattr(bins, n)[:, free] for n in _ESTIMATED}))
    if not parts:
        raise LogError(f"{program.path}: an input that the model needs never has a value; fill its column")
    return Bins(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def forecast_columns(layout: Layout, prediction: Forecast) -> dict[str, FloatArray]:
    """Return the columns of `forecast.csv`, named as those of `estimates.csv`.

    Each is (K,): temperatures in °C with σ in K and, with an expansion coefficient, errors with σ in µm.
    """
    a = prediction.ahead
    columns = layout.along(field__degC=a.field_degC, field__sigma_K=a.field_sigma_K)
    if layout.has_error:
        columns |= layout.along(error__um=a.error_um, error__sigma_um=a.error_sigma_um)
    return columns
