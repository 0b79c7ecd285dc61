"""The last hour, for a viewer who comes now: its field, heats and sensors, a row every few seconds."""

from __future__ import annotations

import json
import math
from collections import deque
from typing import Any

_EVERY_S = 4.0
_HOUR_S = 3600.0
_ROUND = 3


class Recent:
    """Keeps a row each time a field comes and the last row is old enough."""

    def __init__(self) -> None:
        self._rows: deque[dict[str, Any]] = deque(maxlen=math.ceil(_HOUR_S / _EVERY_S))
        self._newest: dict[str, dict[str, Any]] = {}
        self._instance: str | None = None

    def take(self, key: str, data: bytes) -> None:
        """Take a document; raises `ValueError` where it is no JSON."""
        if key not in {"estimate", "heat", "error", "readings", "field"}:
            return
        self._newest[key] = document = json.loads(data)
        if key == "field" and self._is_due(document):
            self._rows.append(self._row(document))

    def document(self) -> dict[str, Any]:
        """The rows, the oldest first, with what they are of."""
        return {"every_s": _EVERY_S, "rows": list(self._rows)}

    def _is_due(self, field: dict[str, Any]) -> bool:
        if not self._rows:
            return True
        since_s = field["time_s"] - self._rows[-1]["time_s"]
        if since_s < 0:  # the clock went back; what is older cannot be drawn beside it
            self._rows.clear()
        return not 0 <= since_s < _EVERY_S

    def _row(self, field: dict[str, Any]) -> dict[str, Any]:
        heat, estimate = self._newest.get("heat", {}), self._newest.get("estimate", {})
        error, readings = self._newest.get("error", {}), self._newest.get("readings", {})
        return {
            "time_s": field["time_s"],
            "quality": field["quality"],
            "temperature_degC": _rounded(field["temperature_degC"]),
            "error_um": _rounded(error.get("error_um") or []),
            "sigma_um": _rounded(error.get("sigma_um") or []),
            "heat_W": {name: entry["heat_W"] for name, entry in heat.get("sources", {}).items()},
            "sigma_W": {name: entry["sigma_W"] for name, entry in heat.get("sources", {}).items()},
            "law_W": dict(zip(estimate.get("sources", []), estimate.get("law_W", []), strict=False)),
            "channels": {name: entry["value"] for name, entry in readings.get("channels", {}).items()},
            "lost": [n for n, entry in readings.get("channels", {}).items() if entry["quality"] != "good"],
        }


def _rounded(values: list[float | None]) -> list[float | None]:
    return [None if value is None else round(value, _ROUND) for value in values]
