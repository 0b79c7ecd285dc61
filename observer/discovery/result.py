"""The results of a calibration or a discovery as plain data for a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from observer.discovery.discover import Discovery
from observer.discovery.displacement import DisplacementFindings
from observer.discovery.experiment import HOPELESS, Experiment
from observer.discovery.family import Tie
from observer.discovery.proof import SensorError
from observer.discovery.search import FittedCandidate
from observer.discovery.verdict import Partial
from observer.discovery.worth import Worth
from observer.fit.calibrate import Calibration, ErrorRms, describe
from observer.fit.hypothesis import FORM_SHARE, NORMAL_95, Fit
from observer.fit.parameters import rounded

CANDIDATE, MOST = "candidate.toml", 0.5
"""The file of the effect that explains most of an unknown, and the least part for a strong candidate: of the
misfit where it was fitted, and of the squared error on the proof.
"""

TEST_CYCLE = "test-cycle.csv"
"""The file of a proposed test: a program, that is a log of the input channels."""


def calibration_result(calibration: Calibration, noise: Mapping[str, float]) -> dict[str, Any]:
    """Return the content of `result.json` of a calibration, as plain data with five significant digits.

    Args:
        calibration: The calibration.
        noise: Fitted process noise by its keys, or nothing.

    Returns:
        Parameters with intervals, remaining tolerances, parameters not identified, process noise, and errors.
    """
    return {
        "calibrated": {
            f.key: {**_interval(f.value, *f.ci95, f.unit), "before": f.before} for f in calibration.fitted
        },
        "left": _rounded({k: v for k, v in calibration.left.items() if k in calibration.written}),
        "not_told": [describe(obstacle) for obstacle in calibration.obstacles],
        "process_noise": _rounded(dict(noise)),
        "gap": {
            **_error(calibration.error),
            "per_sensor": {name: _error(error) for name, error in calibration.per_sensor.items()},
        },
        "held_back": {
            "seconds": calibration.held_back.seconds,
            **_error(calibration.held_back.error),
            "per_sensor": {name: _error(error) for name, error in calibration.held_back.per_sensor.items()},
        },
    }


def _rounded(value: Any) -> Any:
    """Return plain data with every float in it rounded."""
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(one) for one in value]
    return rounded(value) if isinstance(value, float) else value


def _interval(value: float, low: float, high: float, unit: str) -> dict[str, Any]:
    return {"value": rounded(value), "ci95": [rounded(low), rounded(high)], "unit": unit}


def _error(error: ErrorRms | SensorError) -> dict[str, Any]:
    """Return root mean squares of the error in K, or in µm for a displacement."""
    unit = error.unit if isinstance(error, ErrorRms) else "K"
    out: dict[str, Any] = {
        f"{key.removesuffix('K')}{unit}": rounded(value)
        for key, value in asdict(error).items()
        if key.endswith("_rms_K")
    }
    if isinstance(error, SensorError):
        before_K, after_K = map(rounded, error.beyond_tolerances_K)
        out["beyond_tolerances"] = {"before_rms_K": before_K, "after_rms_K": after_K}
    return out


def discovery_result(discovery: Discovery) -> dict[str, Any]:
    """Return the content of `result.json` of a discovery, as plain data with five significant digits.

    Effects are listed only if the verdict is *named*. Sets that cannot be distinguished stand under
    `alternatives`.
    """
    verdict, proof, test = discovery.verdict, discovery.proof, discovery.experiment
    several = verdict.sets if verdict.kind == "ambiguous" else ()
    return {
        "verdict": verdict.kind,
        "reason": verdict.reason,
        "effects": effects_of(verdict.fit) if verdict.kind == "named" else [],
        "alternatives": [[c.name for c in candidates] for candidates in several],
        "family": _family(discovery.ties),
        "calibrated": calibrated_of(verdict.fit),
        "gap": {
            **_error(proof.whole),
            "as_given_rms_K": rounded(proof.as_given_rms_K),
            "per_sensor": {name: _error(error) for name, error in proof.per_sensor.items()},
            "on": "proof",
        },
        "worth": _worth(discovery.worth),
        "where": _locations(discovery),
        "ranking": [_trial(t) for t in discovery.search.ranking],
        "not_told": [c.name for c in discovery.search.blind],
        "partial": _partial(discovery),
        "suspects": [suspect._asdict() for suspect in discovery.suspects],
        "displacements": _displacements(discovery.displacements),
        "experiment": None if test is None else _experiment(test),
    }


def _experiment(test: Experiment) -> dict[str, Any]:
    """Return a test cycle, its phases, and the separation by the other cycles."""
    return {
        "name": test.name,
        "description": test.description,
        "duration_s": test.duration_s,
        "separation_sigma": rounded(test.separation_sigma),
        "phases": [_rounded(phase._asdict()) for phase in test.phases],
        "others": [{"name": name, "separation_sigma": rounded(sigma)} for name, sigma in test.others],
        "program": TEST_CYCLE if test.separation_sigma >= HOPELESS else None,
    }


def effects_of(fit: Fit) -> list[dict[str, Any]]:
    """Return the effects that a fit has added, as plain data.

    Intervals include 1.5 % for the form of an effect, positions and temperatures excepted. They end at the
    bounds.

    Args:
        fit: The fit.

    Returns:
        For each effect its kind, target, and parameters with value, 95 % interval and unit.
    """
    out = []
    before = len(fit.problem.config.effect)
    values = zip(fit.parameters, fit.values.tolist(), fit.half_width.tolist(), strict=True)
    by_effect: dict[int, dict[str, Any]] = {}
    for p, value, half in values:
        info = fit.config.effect[p.effect].parameters[p.key]
        form = 0.0 if info.level else NORMAL_95 * FORM_SHARE * value
        half_width = float(np.hypot(half, form))
        low, high = (
            reciprocal(value, half_width) if info.reciprocal else (value - half_width, value + half_width)
        )
        low, high = max(low, p.low), min(high, p.high)
        by_effect.setdefault(p.effect, {})[p.key] = _interval(value, low, high, info.unit)
    for i, effect in enumerate(fit.config.effect[before:], start=before):
        target = getattr(effect, "target", None)
        out.append({"kind": effect.kind, "target": target, "parameters": by_effect.get(i, {})})
    return out


def reciprocal(value: float, half: float) -> tuple[float, float]:
    """Return the interval of a value whose reciprocal has a symmetric one.

    Args:
        value: The value, positive.
        half: Half width of its linear interval; that of the reciprocal is `half` / value².

    Returns:
        Lower and upper end. The upper one is infinite if the interval of the reciprocal contains 0.
    """
    middle, half = 1.0 / value, half / value**2
    return 1.0 / (middle + half), 1.0 / (middle - half) if middle > half else np.inf


def calibrated_of(fit: Fit) -> dict[str, Any]:
    """Return the free parameters of a fit by key, with value, 95 % interval and unit."""
    return {p.key: _interval(p.value, *p.ci95, p.unit) for p in fit.free_parameters}


def _locations(discovery: Discovery) -> list[dict[str, Any]]:
    """Return where the error is, and first the unexplained event if there is one."""
    places = [_rounded(asdict(place)) for place in discovery.locations]
    if (e := discovery.event) is None:
        return places
    first = {
        "sensor": e.sensor,
        "phase": e.phase,
        "regressor": "event",
        "rms_K": rounded(abs(e.error_K)),
        "mean_K": rounded(e.error_K),
        "log": e.run + 1,
        "from_s": e.from_s,
        "to_s": e.to_s,
        "heat_W": rounded(e.heat_W),
        "heat_sigma_W": rounded(e.sigma_W),
    }
    return [first, *places]


def _partial(discovery: Discovery) -> dict[str, Any] | None:
    """Return the effect that explains most of an unknown, its share, and the remaining error; None
    without one.
    """
    if (partial := discovery.partial) is None:
        return None
    return {
        **effects_of(partial.trial.fit)[-1],
        "share": rounded(partial.share),
        "remains_rms_K": rounded(partial.remains_rms_K),
        "remains_beyond_tolerances_rms_K": rounded(partial.beyond_tolerances_rms_K),
        "most_on": partial.most_on,
        "phase": partial.phase,
        "family": None if partial.tie is None else _tie(partial.tie),
        "log": partial.log + 1,
        "proof": {"before_rms_K": rounded(partial.proof_K[0]), "after_rms_K": rounded(partial.proof_K[1])},
        "worth": _worth(partial.worth),
        "candidate": CANDIDATE,
        "explains_most": _explains_most(partial),
    }


def _displacements(findings: DisplacementFindings | None) -> dict[str, Any] | None:
    """Return the findings of displacement sensors, None without any."""
    if findings is None:
        return None
    return {
        "verdict": findings.verdict,
        "causes": [
            {"key": c.key, "before": rounded(c.before), **_interval(c.value, *c.ci95, c.unit)}
            for c in findings.causes
        ],
        "supports": findings.supports,
        "per_sensor": {name: _rounded(error._asdict()) for name, error in findings.per_sensor.items()},
    }


def _explains_most(partial: Partial) -> bool:
    before_K, after_K = partial.proof_K
    return partial.share >= MOST and after_K**2 <= (1.0 - MOST) * before_K**2


def _worth(worth: Worth | None) -> dict[str, float] | None:
    """Return the gain in thermal error by a change of the model, None without an expansion coefficient."""
    return None if worth is None else _rounded(worth._asdict())


def _family(ties: Sequence[Tie]) -> dict[str, Any] | None:
    """Return the family of an answer, and the effects common to all of its sets."""
    return {**_tie(ties[0]), "beside": [_tie(tie) for tie in ties[1:]]} if ties else None


def _tie(tie: Tie) -> dict[str, Any]:
    """Return members that explain the logs equally well; a single one without a family is in every set."""
    members = [c.name for c in tie.members]
    if tie.family is None or tie.figure is None:
        return {"name": None, "target": None, "members": members, "effective": {}}
    figure = _interval(tie.figure.value, *tie.figure.ci95, tie.family.unit)
    return {
        "name": tie.family.name,
        "target": tie.place,
        "members": members,
        "effective": {tie.family.key: figure},
    }


def _trial(trial: FittedCandidate) -> dict[str, Any]:
    """Return a candidate of the first round with the fraction of the error that it explains, fitted and
    held out.
    """
    effect = effects_of(trial.fit)[-1]
    return {
        **effect,
        "evidence": rounded(trial.drop),
        "held_out_share": rounded(trial.held_out),
        "at_bound": trial.fit.at_bound,
        "accepted": trial.accepted,
    }
