"""What a calibration found, as plain data for a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from observer.discovery.calibrate import Calibration, Gap
from observer.discovery.identifiability import describe
from observer.discovery.write_back import rounded


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
