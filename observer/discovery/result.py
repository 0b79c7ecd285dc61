"""What a calibration or a discovery found, as plain data for a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from observer.discovery.discover import Discovery
from observer.discovery.search import Trial
from observer.fit.calibrate import Calibration, Gap
from observer.fit.hypothesis import NORMAL_95, Fit
from observer.fit.identifiability import describe
from observer.fit.parameters import kind_of, rounded


def calibration_result(calibration: Calibration, noise: Mapping[str, float]) -> dict[str, Any]:
    """Return the content of `result.json`: parameters with intervals, what could not be told, and the gap."""
    return {
        "calibrated": {
            f.key: {
                "value": rounded(f.value),
                "ci95": [rounded(bound) for bound in f.ci95],
                "unit": f.unit,
                "before": f.before,
            }
            for f in calibration.fitted
        },
        "not_told": [describe(obstacle) for obstacle in calibration.obstacles],
        "process_noise": {key: rounded(value) for key, value in noise.items()},
        "gap": {
            **_gap(calibration.gap),
            "per_sensor": {name: _gap(gap) for name, gap in calibration.per_sensor.items()},
        },
    }


def _gap(gap: Gap) -> dict[str, float]:
    return {"before_rms_K": rounded(gap.before_rms_K), "after_rms_K": rounded(gap.after_rms_K)}


FORM_SHARE = 0.015
"""How far an effect's own form may be from that of the machine, as a part of its parameters, places and
temperatures aside: one σ."""


def discovery_result(found: Discovery) -> dict[str, Any]:
    """Return the content of `result.json` of a discovery."""
    verdict, proof = found.verdict, found.proof
    return {
        "verdict": verdict.kind,
        "reason": verdict.reason,
        "effects": effects_of(verdict.fit) if verdict.kind == "named" else [],
        "alternatives": [[c.name for c in each] for each in verdict.sets]
        if verdict.kind == "ambiguous"
        else [],
        "calibrated": calibrated_of(verdict.fit),
        "gap": {
            "before_rms_K": rounded(proof.whole.before_rms_K),
            "after_rms_K": rounded(proof.whole.after_rms_K),
            "floor_rms_K": rounded(proof.whole.floor_rms_K),
            "as_given_rms_K": rounded(proof.as_given_rms_K),
            "per_sensor": {
                name: {
                    "before_rms_K": rounded(gap.before_rms_K),
                    "after_rms_K": rounded(gap.after_rms_K),
                    "floor_rms_K": rounded(gap.floor_rms_K),
                }
                for name, gap in proof.per_sensor.items()
            },
            "on": "proof",
        },
        "where": _where(found),
        "ranking": [_trial(t) for t in found.search.ranking],
        "not_told": [c.name for c in found.search.blind],
        "experiment": None
        if found.experiment is None
        else {
            "name": found.experiment.name,
            "description": found.experiment.description,
            "duration_s": found.experiment.duration_s,
            "separation_sigma": rounded(found.experiment.separation_sigma),
        },
    }


def effects_of(fit: Fit) -> list[dict[str, Any]]:
    """The effects of a fit with their parameters and 95 % intervals, those configured before left out."""
    out = []
    before = len(fit.problem.config.effect)
    values = zip(fit.parameters, fit.values.tolist(), fit.half_width.tolist(), strict=True)
    by_effect: dict[int, dict[str, Any]] = {}
    for p, value, half in values:
        known = fit.config.effect[p.effect].parameters[p.key]
        form = 0.0 if known.level else NORMAL_95 * FORM_SHARE * value
        wide = float(np.hypot(half, form))
        by_effect.setdefault(p.effect, {})[p.key] = {
            "value": rounded(value),
            "ci95": [rounded(max(value - wide, p.low)), rounded(min(value + wide, p.high))],
            "unit": known.unit,
        }
    for i, effect in enumerate(fit.config.effect[before:], start=before):
        target = getattr(effect, "target", None)
        out.append({"kind": effect.kind, "target": target, "parameters": by_effect.get(i, {})})
    return out


def calibrated_of(fit: Fit) -> dict[str, Any]:
    """The free parameters of a fit with their 95 % intervals."""
    problem = fit.problem
    values = problem.free_values(fit.config).tolist()
    out = {}
    for key, value, half in zip(problem.keys, values, fit.half_width_free.tolist(), strict=True):
        low, high = max(value - half, kind_of(key).low), min(value + half, kind_of(key).high)
        out[key] = {
            "value": rounded(value),
            "ci95": [rounded(low), rounded(high)],
            "unit": kind_of(key).unit,
        }
    return out


def _where(found: Discovery) -> list[dict[str, Any]]:
    places = [
        {
            "sensor": p.sensor,
            "phase": p.phase,
            "regressor": p.regressor,
            "rms_K": rounded(p.rms_K),
            "mean_K": rounded(p.mean_K),
            "correlation": rounded(p.correlation),
            "correlation_ci95": [rounded(x) for x in p.ci95],
        }
        for p in found.where
    ]
    if (e := found.event) is None:
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


def _trial(trial: Trial) -> dict[str, Any]:
    """A candidate of the first round: what it explains of the error, and of that on data held out."""
    effect = effects_of(trial.fit)[-1]
    return {
        **effect,
        "evidence": rounded(trial.drop),
        "held_out_share": rounded(trial.held_out),
        "at_bound": trial.fit.at_bound,
        "accepted": trial.accepted,
    }
