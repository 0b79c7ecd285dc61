"""A self-test that always runs: do sensors and model agree, and does each heat lie near its law?

Innovations of a filter with a correct model are white, with mean zero and the predicted variance (Kailath
1968; Mehra and Peschon 1971). They are averaged over about a minute and about ten, per sensor. Heats can
compensate for a wrong model or input. Each heat is therefore compared with its law, within the law's
uncertainty. All heats are also compared together, because a wrong film or ambient moves all of them one way.
A failed test lowers the quality and gives a reason. It clears when the last minute passes.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from observer.estimators.protocol import EstimatorState
from observer.frames import EstimateBlock, FloatArray, FrameBlock, Inputs, Layout, QualityArray
from observer.kernels import codes as of
from observer.kernels import compare_ways, longest_way, record, run_selftest
from observer.kernels.layout import Records, packed, state_type
from observer.kernels.screening import READMIT_S
from observer.kernels.selftest import OF_HEAT, OF_SENSOR, SKEW_S, GREATEST_ACCELERATION_m_s2, ROUNDED_m
from observer.model.plant import Plant

_SLACK = 1.4
"""Factor on the limits, which are then 3.5 and 2.8 standard deviations of all heats together.

One in twenty machines within their tolerances would pass a limit of 2.
"""


class Fault(IntEnum):
    """Failures of the self-test and findings of the screening.

    Self-test: of a sensor (0 to 3), of a heat (4, 5), of all heats (6), of a nut (7, 8). Screening: of a
    sensor (9, 10), of all sensors (11 to 16), of the air (17).
    """

    BIASED = 0
    COLOURED = 1
    NOISY = 2
    REFUSED = 3
    UNKNOWN = 4
    OFF_LAW = 5
    ALL_OFF_LAW = 6
    MOTION = 7
    LEAPT = 8
    EXCLUDED = 9
    SWAPPED = 10
    SHARED_OFFSET = 11
    GAIN = 12
    UNEXPLAINED = 13
    DRIFTING = 14
    AMBIGUOUS = 15
    SETTLING = 16
    AIR_LEAPT = 17


@dataclass(frozen=True, slots=True)
class Finding:
    """A failed test or a finding of the screening.

    Attributes:
        fault: The kind of failure.
        subject: Name of the sensor, the source or the nut's position channel; empty if it concerns all.
        since_s: Time of its start, s since the epoch.
        value: Size. For a sensor: a mean in σ, a correlation, a ratio to the expected noise, an innovation in
            K, or an excess in K. Else a heat in W, a ratio of travelled distances, or a jump in m.
        expected: The value that `value` is compared with: σ for an excess, the time in s between polls for a
            jump.
        other: The sensor that the subject was exchanged with, or empty.
        unit: Unit of the subject's readings, `K`, or `um` for a displacement.
        returns_s: Time until an excluded sensor that agrees again is used, s, NaN while it does not agree.
    """

    fault: Fault
    subject: str
    since_s: float
    value: float
    expected: float
    other: str = ""
    unit: str = "K"
    returns_s: float = math.nan


class SelfTestState(NamedTuple):
    """The memory of the self-test of s sensors, m_e heats, M nuts and T tests.

    Attributes:
        sensor: Means of innovations by window, records of `kernels/states.pxd`, (s, 2).
        last: Last innovation of each sensor, records, (s,).
        heat: Mean distance from the law by window, (m_e + 1, 2); the last row is that of all heats.
        peak_W: Largest heat by each law of the last hour, fading, W, (m_e,).
        motion: Motion of each nut, records, (M,).
        since_s: Time since which each test fails, s, (T,), NaN while it passes.
        value: Size of the failure, (T,), as in `Finding.value`.
        expected: Its reference, (T,), as in `Finding.expected`.
        steps: Number of failed steps since the start, (T,).
        first_s: Time of the first, s, (T,), NaN without one.
        refused: 1 if a sensor was rejected at the last step, (1,).
    """

    sensor: Records
    last: Records
    heat: FloatArray
    peak_W: FloatArray
    motion: Records
    since_s: FloatArray
    value: FloatArray
    expected: FloatArray
    steps: FloatArray
    first_s: FloatArray
    refused: FloatArray


class Trust(NamedTuple):
    """References of the tests.

    Attributes:
        initial_W: σ of each heat at the start, W, (m_e,).
        law_uncertainty: Relative σ of each law, (m_e,), NaN for a source without a law.
        noise_K: σ of the sensors' noise, K, (s,), infinite where no tolerance is considered.
        law_slack: Factor on the limits of heats, 1 without tolerances.
    """

    initial_W: FloatArray
    law_uncertainty: FloatArray
    noise_K: FloatArray
    law_slack: float


class Tested(NamedTuple):
    """K steps as the kernel takes them; names and shapes as in `Inputs` and `EstimateBlock`.

    Attributes:
        input_quality: Quality of each reading before the estimator, (K, s).
        sensor_quality: Quality after it, (K, s).
        nu: Innovations, K or µm, (K, s).
        nu_sigma: Their predicted σ, K or µm, (K, s).
        motion: Records of the nuts' motion in each step, (K, M).
    """

    time_s: FloatArray
    dt_s: FloatArray
    input_quality: QualityArray
    sensor_quality: QualityArray
    nu: FloatArray
    nu_sigma: FloatArray
    heat_W: FloatArray
    heat_sigma_W: FloatArray
    law_W: FloatArray
    motion: Records


MOTION_STEP = state_type("MotionStep")


def no_motion_yet(nuts: int = 1) -> Records:
    """Return the memory of the motion of nuts before their first samples.

    Args:
        nuts: Number M of nuts.

    Returns:
        Records of `kernels/states.pxd`, (M,). Times, positions and speeds are NaN.
    """
    memory = np.zeros(nuts, state_type("NutMotion"))
    for name in ("time_s", "place_m", "speed_m_s", "speed_age_s"):
        memory[name] = np.nan
    memory["lowest_m"], memory["highest_m"] = np.inf, -np.inf
    return memory


def smallest_jump_m(period_s: float) -> float:
    """Return the smallest jump that is found of a nut at rest, m.

    A smaller difference could be a motion between two polls, with at most 12 m/s² of acceleration.

    Args:
        period_s: Time between two polls of the position, s.
    """
    return float(longest_way(0.0, 0.0, GREATEST_ACCELERATION_m_s2 * SKEW_S, period_s)) + ROUNDED_m


class SelfTest:
    """The self-test of one plant; holds no state of its own.

    Attributes:
        trust_record: Record of `Trust`.
        travel_m: Lowest and highest position of each nut, m, by its position channel.
    """

    def __init__(self, plant: Plant, with_law: Collection[str]) -> None:
        """Fix the tests and their references.

        Args:
            plant: The model. If it learns parameters, limits of heats are 1.4 times as wide.
            with_law: Names of the sources that have a law. The heats of others are not compared with a law.
        """
        has_law = np.array([name in with_law for name in plant.layout.sources], dtype=np.bool_)
        noise_K = np.sqrt(plant.noise_R_K2) if plant.learnt else np.full(plant.rows.sensors, np.inf)
        trust = Trust(
            plant.initial_sigma_W,
            np.where(has_law, plant.law_uncertainty, np.nan),
            noise_K,
            _SLACK if plant.learnt else 1.0,
        )
        self.trust_record = record(packed(trust))
        self._sensors, self._sources = plant.layout.sensors, plant.layout.sources
        self._unit = dict(zip(self._sensors, plant.layout.units, strict=True))
        self.travel_m = {s.channel: s.reach_m or (0.0, s.table.screw_m) for s in plant.moving}

    def initial(self) -> SelfTestState:
        """Return the state before the first step, in which all tests pass."""
        s, m_e, M = len(self._sensors), len(self._sources), len(self.travel_m)
        tests = OF_SENSOR * s + OF_HEAT * m_e + 1 + 2 * M
        return SelfTestState(
            sensor=np.zeros((s, 2), state_type("InnovationWindow")),
            last=np.full(s, np.nan, state_type("LastInnovation")),
            heat=np.zeros((m_e + 1, 2)),
            peak_W=np.zeros(m_e),
            motion=no_motion_yet(M),
            since_s=np.full(tests, np.nan),
            value=np.full(tests, np.nan),
            expected=np.full(tests, np.nan),
            steps=np.zeros(tests),
            first_s=np.full(tests, np.nan),
            refused=np.zeros(1),
        )

    def watch(
        self, state: SelfTestState, frames: FrameBlock, inputs: Inputs
    ) -> tuple[SelfTestState, FloatArray, Inputs]:
        """Compare each nut's travelled distance with its speed, before the estimator runs.

        Args:
            state: Memory of the tests.
            frames: K frames with the samples of the positions.
            inputs: The same steps as inputs of the estimator.

        Returns:
            The state with the motion updated. The motion of the nuts in each step, records, (K, M). The
            inputs, with `degraded` raised where the position of a nut is lost.
        """
        state = state._replace(motion=state.motion.copy())
        motion = np.empty((len(inputs), len(self.travel_m)), MOTION_STEP)
        degraded = inputs.degraded.copy()
        for i, (channel, travel_m) in enumerate(self.travel_m.items()):
            path, memory = record(frames.path[channel]), state.motion[i : i + 1]
            compare_ways(path, np.array(travel_m), memory, motion[:, i], degraded)
        return state, motion, inputs._replace(degraded=degraded)

    def run(
        self, state: SelfTestState, motion: FloatArray, inputs: Inputs, block: EstimateBlock
    ) -> tuple[SelfTestState, EstimateBlock]:
        """Test K steps, and lower the qualities of estimates that fail.

        Args:
            state: The state that `watch` returned.
            motion: The motion that `watch` returned, (K, M).
            inputs: The steps, with the `degraded` that `watch` returned.
            block: Their estimates.

        Returns:
            The state after the steps, and the estimates with their final `quality` and `part_quality`.
        """
        quality, part_quality = block.quality.copy(), block.part_quality.copy()
        tested = Tested(
            block.time_s, inputs.dt_s, inputs.quality, block.sensor_quality, block.innovation_K,
            block.innovation_sigma_K, block.heat_W, block.heat_sigma_W, block.law_W, motion,
        )  # fmt: skip
        state = SelfTestState._make(array.copy() for array in state)
        records = record(packed(tested)), self.trust_record, record(state)
        run_selftest(*records, quality, part_quality, np.empty(3))
        return state, replace(block, quality=quality, part_quality=part_quality)

    def findings(self, state: SelfTestState) -> tuple[Finding, ...]:
        """Return the current failures, in the order of the tests, each since its last start."""
        return tuple(
            self._finding(state, test, state.since_s)
            for test in np.flatnonzero(np.isfinite(state.since_s)).tolist()
        )

    def history(self, state: SelfTestState) -> tuple[tuple[Finding, int], ...]:
        """Return all failures since the start of the state.

        Returns:
            Pairs of a finding and its number of failed steps. A finding has the time of its first failure and
            the size of its last.
        """
        return tuple(
            (self._finding(state, test, state.first_s), int(state.steps[test]))
            for test in np.flatnonzero(state.steps).tolist()
        )

    def _finding(self, state: SelfTestState, test: int, since_s: FloatArray) -> Finding:
        fault, subject = self._meaning(test)
        return Finding(
            fault, subject, float(since_s[test]), float(state.value[test]), float(state.expected[test]),
            unit=self._unit.get(subject, "K") if fault is Fault.REFUSED else "K",
        )  # fmt: skip

    def _meaning(self, test: int) -> tuple[Fault, str]:
        s, m_e = len(self._sensors), len(self._sources)
        if test < OF_SENSOR * s:
            return Fault(test % OF_SENSOR), self._sensors[test // OF_SENSOR]
        test -= OF_SENSOR * s
        if test < OF_HEAT * m_e:
            return Fault(OF_SENSOR + test % OF_HEAT), self._sources[test // OF_HEAT]
        test -= OF_HEAT * m_e
        if test == 0:
            return Fault.ALL_OFF_LAW, ""
        nuts = list(self.travel_m)
        return (Fault.MOTION if test <= len(nuts) else Fault.LEAPT), nuts[(test - 1) % len(nuts)]


_LATCHED = {
    of.GAIN: Fault.GAIN, of.DRIFTING: Fault.DRIFTING, of.AMBIGUOUS: Fault.AMBIGUOUS,
    of.AIR_LEAPT: Fault.AIR_LEAPT,
}  # fmt: skip
"""Faults of latched verdicts; others are `UNEXPLAINED`: unequal jumps, or equal ones without an offset."""


def screening_findings(layout: Layout, state: EstimatorState) -> tuple[Finding, ...]:
    """Return the current findings of the screening.

    Args:
        layout: Names and units of the sensors.
        state: State of the estimator. Without screening its `guard` is empty and no sensor is named.
    """
    return tuple(finding for finding, _ in _of_all(layout, state, now=True))


def screening_history(layout: Layout, state: EstimatorState) -> tuple[tuple[Finding, int], ...]:
    """Return all findings of the screening since the start, each with its number of steps.

    Arguments as in `screening_findings`. A sensor that is used again has `returns_s` NaN.
    """
    return tuple(_of_all(layout, state, now=False))


def _of_all(layout: Layout, state: EstimatorState, *, now: bool) -> list[tuple[Finding, int]]:
    findings = []
    for name, unit, sensor in zip(layout.sensors, layout.units, state.guard, strict=False):
        if sensor.cause if now else sensor.steps_out:
            fault, other = Fault.EXCLUDED, ""
            if sensor.cause == of.SWAPPED:
                fault, other = Fault.SWAPPED, layout.sensors[int(sensor.partner)]
            excess, sigma = float(sensor.excess_K), float(sensor.excess_sigma_K)
            agrees_s = float(sensor.agrees_s) if now else 0.0
            returns_s = max(READMIT_S - agrees_s, 0.0) if agrees_s > 0.0 else math.nan
            since_s = float(sensor.first_out_s)
            finding = Finding(fault, name, since_s, excess, sigma, other, unit, returns_s)
            findings.append((finding, int(sensor.steps_out)))
    verdict = state.verdict[0]
    if verdict.common_K:
        since_s, offset_K = float(verdict.common_from_s), float(verdict.common_K)
        findings.append((Finding(Fault.SHARED_OFFSET, "", since_s, offset_K, 0.0), int(verdict.common_steps)))
    if verdict.latch:
        fault = _LATCHED.get(int(verdict.latch), Fault.UNEXPLAINED)
        finding = Finding(fault, "", float(verdict.latched_s), float(verdict.factor), 1.0)
        findings.append((finding, int(verdict.latch_steps)))
    if max(verdict.hold_s, verdict.settling_s) > 0.0 if now else verdict.held_steps > 0.0:
        finding = Finding(Fault.SETTLING, "", float(verdict.held_from_s), 0.0, 0.0)
        findings.append((finding, int(verdict.held_steps)))
    return findings
