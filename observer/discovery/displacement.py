"""The findings of displacement sensors, once the heat is judged: do temperatures explain how far the screw
grows?

The search for effects uses temperatures only, so that nothing that moves the axis without warming it is taken
for heat. Its answer must then agree with the displacements: both are fitted with one deviance. Each cause
that moves the axis without heat is added in turn: the expansion coefficient, the supports, a bed that grows
with the air, a drift. Such a cause is named by the same rules as an effect. The name of a heat effect is
withdrawn if it makes the prediction of the displacements worse.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sections import Bed
from observer.discovery.proof import proves, rms
from observer.discovery.search import ACCEPT
from observer.discovery.verdict import WITHIN_REACH, WITHIN_SHARE, Verdict
from observer.fit.evidence import Evidence
from observer.fit.hypothesis import NORMAL_95, Fit, fit_effects, fit_null
from observer.fit.parameters import candidates, free_keys, info_of
from observer.fit.problem import Problem
from observer.fit.runs import Run, prepare_all
from observer.frames import BoolArray, FloatArray, FrameBlock

BED = "bed.expansion_1_K"
KEYS = (
    "screw.expansion_1_K",
    "supports.stiffness_first_N_m",
    "supports.stiffness_second_N_m",
    "supports.preload_N",
    BED,
)
"""Values of the configuration that move the axis and warm nothing."""
FEWEST, FEWEST_PROOF = 8, 3
"""Half-minute means of displacements with which something can be said, and of those held back."""
UNEXPLAINED = 0.7
"""Error of the displacements beyond tolerances and noise, as a multiple of the form error, beyond which
something else moves the axis.
"""
HOUR_S = 3600.0
AGAINST = "the displacements held back are predicted worse with what would explain the temperatures"

DisplacementVerdict = Literal["explained", "named", "ambiguous", "unknown", "not_identifiable"]


class Cause(NamedTuple):
    """A cause that moves the axis without heat, fitted to n rows.

    Attributes:
        key: Key of the configuration, or "drift of" with the name of a sensor.
        unit: Unit of its values.
        before: Configured value.
        value: Fitted value.
        ci95: 95 % interval.
        drop: Fall of the deviance.
        beyond_um: Remaining error of each row beyond tolerances, µm, (n,).
    """

    key: str
    unit: str
    before: float
    value: float
    ci95: tuple[float, float]
    drop: float
    beyond_um: FloatArray


class DisplacementError(NamedTuple):
    """The error of a sensor's predictions on held-out data, beyond tolerances and about its mean.

    Attributes:
        before_rms_um: Rms without the cause, µm.
        after_rms_um: Rms with it, µm.
        floor_rms_um: Rms of noise alone, µm.
    """

    before_rms_um: float
    after_rms_um: float
    floor_rms_um: float


@dataclass(frozen=True)
class DisplacementFindings:
    """The findings of the displacement sensors.

    Attributes:
        verdict: "explained", "named" with one cause, "ambiguous" with several, "unknown" or
            "not_identifiable".
        causes: The cause that is named, or those that cannot be distinguished.
        per_sensor: Error of each sensor on held-out data.
        supports: Whether they support a named heat effect; None if they show neither.
    """

    verdict: DisplacementVerdict
    causes: tuple[Cause, ...]
    per_sensor: dict[str, DisplacementError]
    supports: bool | None

    @property
    def values(self) -> dict[str, float]:
        """The named value by its key; empty if none is named or the configuration lacks the key."""
        if self.verdict != "named":
            return {}
        return {c.key: c.value for c in self.causes if c.key in KEYS and (c.key != BED or c.before > 0.0)}


def displacements_of(
    config: Config, runs: Sequence[Sequence[FrameBlock]], verdict: Verdict, null: Fit
) -> DisplacementFindings | None:
    """Return the findings of a configuration's displacement sensors, None if it has none.

    With too few half-minute means the verdict is *not identifiable*.

    Args:
        config: The machine with its displacement sensors.
        runs: Frames of each log.
        verdict: Verdict on the temperatures, whose effects are taken over.
        null: Fit to the temperatures without effects.
    """
    if all(sensor.kind == "temperature" for sensor in config.sensor):
        return None
    prepared = prepare_all(config, runs)
    both = _JointFit.of(config, prepared, verdict.fit)
    if both.moved[both.evidence.used].sum() < FEWEST or both.moved[both.evidence.proof].sum() < FEWEST_PROOF:
        return DisplacementFindings("not_identifiable", (), {}, None)
    causes = sorted(both.causes(), key=lambda cause: -cause.drop)
    sound = [cause for cause in causes if both.is_sound(cause)]
    near = [c for c in sound if c.drop >= sound[0].drop - max(WITHIN_REACH, WITHIN_SHARE * sound[0].drop)]
    after_um = near[0].beyond_um if near else both.beyond_um
    kind: DisplacementVerdict = "explained"
    if any(both.gap(after_um, rows) > UNEXPLAINED for rows in (both.evidence.used, both.evidence.proof)):
        kind, near = "unknown", []
    elif near:
        kind = "named" if len(near) == 1 else "ambiguous"
    supports = None
    if verdict.kind == "named":
        supports = _supported(_JointFit.of(config, prepared, null), both, after_um)
    return DisplacementFindings(kind, tuple(near), both.errors(after_um), supports)


def _supported(without: _JointFit, both: _JointFit, after_um: FloatArray) -> bool | None:
    """Whether the named effects improve the prediction of held-out displacements; None if they change
    nothing.

    Both predictions may include the cause that suits them best.
    """
    rows = both.evidence.proof
    sound = [cause for cause in without.causes() if without.is_sound(cause)]
    before_um = max(sound, key=lambda cause: cause.drop).beyond_um if sound else without.beyond_um
    before, after = without.rms_um(before_um, rows), both.rms_um(after_um, rows)
    if proves(after, before, both.noise_um):
        return False
    return True if proves(before, after, both.noise_um) else None


@dataclass(frozen=True)
class _JointFit:
    """A fit to temperatures and displacements together; `moved` (n,) marks the rows of displacements."""

    fit: Fit
    moved: BoolArray

    @classmethod
    def of(cls, config: Config, runs: Sequence[Run], thermal: Fit) -> _JointFit:
        """Fit the free parameters of a configuration with the effects of a fit to its temperatures."""
        config = thermal.config.model_copy(update={"sensor": config.sensor, "calibrate": config.calibrate})
        problem = Problem.of(config, free_keys(config), runs)
        kinds = np.array([sensor.kind == "displacement" for sensor in config.sensor])
        return cls(fit_null(problem, config), kinds[problem.evidence.sensor])

    @property
    def evidence(self) -> Evidence:
        """The rows of the fit."""
        return self.fit.problem.evidence

    @cached_property
    def beyond_um(self) -> FloatArray:
        """Measured minus predicted of every row (n,), beyond what tolerances explain; displacements in µm."""
        return np.asarray(self.fit.problem.error_K(self.fit.config) - self.fit.within_tolerances_K())

    @property
    def noise_um(self) -> float:
        """The white noise of held-out displacements, rms."""
        return rms(self.evidence.noise_K[self.evidence.proof & self.moved])

    def rms_um(self, beyond_um: FloatArray, rows: BoolArray) -> float:
        """Return the rms of errors (n,) of displacements in some rows, of each sensor and log about its
        mean.
        """
        run, sensor = self.evidence.run, self.evidence.sensor
        squares = 0.0
        for i, s in {*zip(run[rows & self.moved].tolist(), sensor[rows & self.moved].tolist(), strict=True)}:
            errors_um = beyond_um[rows & (run == i) & (sensor == s)]
            squares += float(np.sum((errors_um - errors_um.mean()) ** 2))
        return float(np.sqrt(squares / max((rows & self.moved).sum(), 1)))

    def gap(self, beyond_um: FloatArray, rows: BoolArray) -> float:
        """Return the excess of errors (n,) over noise, as a multiple of the form error."""
        counted = rows & self.moved
        noise_um2, whole_um2 = (
            float(np.mean(d[counted] ** 2)) for d in (self.evidence.noise_K, self.evidence.deviation_K)
        )
        by_chance = 1.0 + 2.0 * np.sqrt(2.0 / counted.sum())
        excess_um2 = self.rms_um(beyond_um, rows) ** 2 - by_chance * noise_um2
        return float(np.sqrt(max(excess_um2, 0.0) / (whole_um2 - noise_um2)))

    def is_sound(self, cause: Cause) -> bool:
        """Whether a cause explains the fitted data and proves itself on held-out data."""
        before, after = (self.rms_um(e, self.evidence.proof) for e in (self.beyond_um, cause.beyond_um))
        return cause.drop >= ACCEPT and proves(before, after, self.noise_um)

    def causes(self) -> Iterator[Cause]:
        """Yield each possible cause that moves the axis without heat, fitted."""
        config, keys = self.fit.config, self.fit.problem.keys
        for key in KEYS:
            if key in candidates(config) and key not in keys:
                yield self._by_key(key)
        hours = self.evidence.time_s / HOUR_S
        for i in np.unique(self.evidence.sensor[self.moved]).tolist():
            drift = np.where(self.evidence.sensor == i, hours, 0.0)
            yield self._by_column(f"drift of {config.sensor[i].name}", "um/h", drift)
        if config.bed is None and config.ambient.channel is not None:
            yield self._by_column(BED, info_of(BED).unit, self._of_a_bed(config.ambient.channel))

    def _of_a_bed(self, air: str) -> FloatArray:
        """Return the change of each row (n,) in µm for an expansion of 1/K of a bed as warm as the air."""
        problem, config = self.fit.problem, self.fit.config
        bed = Bed(expansion_1_K=1e-5, channel=air)
        on_it = problem.predicted(config.model_copy(update={"bed": bed}))
        return np.asarray((on_it - problem.predicted(config)) / bed.expansion_1_K)

    def _by_key(self, key: str) -> Cause:
        """Return a key of the configuration as a cause, fitted with all free parameters."""
        null_problem, config = self.fit.problem, self.fit.config
        problem = replace(null_problem, keys=(*null_problem.keys, key), by_free=None)
        fit = fit_effects(problem.linearised_at(config), config, ())
        value, half = float(problem.free_values(fit.config)[-1]), float(fit.half_width_free[-1])
        before = float(problem.free_values(config)[-1])
        beyond_um = problem.error_K(fit.config) - fit.within_tolerances_K()
        ci95 = value - half, value + half
        return Cause(key, info_of(key).unit, before, value, ci95, self.fit.deviance - fit.deviance, beyond_um)

    def _by_column(self, name: str, unit: str, column_um: FloatArray) -> Cause:
        """Return a multiple of a column (n,) in µm as a cause, fitted with all free parameters."""
        fit, problem = self.fit, self.fit.problem
        whitened = self.evidence.whitened(column_um)
        linear = replace(fit, jacobian=np.column_stack([fit.jacobian, whitened])).linear(self.evidence.used)
        step = linear.step
        value, half = float(step[-1]), NORMAL_95 * float(linear.sigma[-1])
        config = problem.with_free(fit.config, problem.free_values(fit.config) - step[:-1] * problem.scale)
        error_um = problem.error_K(config) - value * column_um
        moved = replace(fit, config=config, residual=self.evidence.whitened(error_um))
        beyond_um = error_um - moved.within_tolerances_K()
        return Cause(
            name, unit, 0.0, value, (value - half, value + half), fit.deviance - moved.deviance, beyond_um
        )

    def errors(self, after_um: FloatArray) -> dict[str, DisplacementError]:
        """Return the error of each displacement sensor on held-out data, before and `after_um` (n,)."""
        evidence, by_name = self.evidence, {}
        for i in np.unique(evidence.sensor[self.moved]).tolist():
            rows = evidence.proof & (evidence.sensor == i)
            if rows.any():
                before, after = (float(np.std(beyond_um[rows])) for beyond_um in (self.beyond_um, after_um))
                name = self.fit.config.sensor[i].name
                by_name[name] = DisplacementError(before, after, rms(evidence.noise_K[rows]))
        return by_name
