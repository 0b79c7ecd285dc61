"""The composition root: the one place that puts parts together, one function per command."""

from observer.app.logs import forecast, identify, replay, simulate
from observer.app.machines import init, service, wires
from observer.app.models import adopt, adopted, calibrate, discover, learned, place

__all__ = [
    "adopt", "adopted", "calibrate", "discover", "forecast", "identify", "init", "learned", "place",
    "replay", "service", "simulate", "wires",
]  # fmt: skip
