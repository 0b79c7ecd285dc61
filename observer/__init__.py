"""Ballscrew Observer: a ball screw's temperature field, heat inputs and thermal error, in real time.

    import observer

    machine = observer.load("machine.toml")
    estimates = machine.replay("run.csv")
    estimates["heat_nut_W"]

Names in `__all__` are documented and stable; everything else is private.
"""

import importlib
import os
from typing import TYPE_CHECKING

# Matrices here are small: BLAS' threads would only wait for each other, all the more on a busy computer.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:  # `import observer` alone loads nothing, since it also starts the service
    from observer.errors import ConfigError, LogError, UserError
    from observer.files.logs import Log
    from observer.intake.importing import ImportedLog
    from observer.library.client import ServiceClient, ServiceStream, connect
    from observer.library.comparing import Comparison
    from observer.library.exporting import ExportedFiles
    from observer.library.findings import CheckFindings, FoundEffect, FoundValue
    from observer.library.given import read_log
    from observer.library.heats import IdentifiedHeats
    from observer.library.importing import extract_log, import_log
    from observer.library.looking_back import PublishedSteps, past
    from observer.library.machine import (
        CalibrationResult,
        DiscoveryResult,
        LearnedParameters,
        Machine,
        discover,
        load,
    )
    from observer.library.messages import (
        ServiceAlarm,
        ServiceAlarms,
        ServiceField,
        ServiceHealth,
        ServiceHeat,
        ServiceThermalError,
        SourceHeat,
    )
    from observer.library.placing import PlacedSensors, SensorPlaces
    from observer.library.predicting import ForecastRun, SimulatedRun
    from observer.library.profiles import ReportGrid
    from observer.library.replaying import Estimates
    from observer.library.signals import SignalTable
    from observer.library.steady import SteadyScrew

    __version__: str

__all__ = [
    "CalibrationResult",
    "CheckFindings",
    "Comparison",
    "ConfigError",
    "DiscoveryResult",
    "Estimates",
    "ExportedFiles",
    "ForecastRun",
    "FoundEffect",
    "FoundValue",
    "IdentifiedHeats",
    "ImportedLog",
    "LearnedParameters",
    "Log",
    "LogError",
    "Machine",
    "PlacedSensors",
    "PublishedSteps",
    "ReportGrid",
    "SensorPlaces",
    "ServiceAlarm",
    "ServiceAlarms",
    "ServiceClient",
    "ServiceField",
    "ServiceHealth",
    "ServiceHeat",
    "ServiceStream",
    "ServiceThermalError",
    "SignalTable",
    "SimulatedRun",
    "SourceHeat",
    "SteadyScrew",
    "UserError",
    "__version__",
    "connect",
    "discover",
    "extract_log",
    "import_log",
    "load",
    "past",
    "read_log",
]

_MODULES = {
    "errors": ("ConfigError", "LogError", "UserError"),
    "files.logs": ("Log",),
    "intake.importing": ("ImportedLog",),
    "library.client": ("ServiceClient", "ServiceStream", "connect"),
    "library.comparing": ("Comparison",),
    "library.exporting": ("ExportedFiles",),
    "library.findings": ("CheckFindings", "FoundEffect", "FoundValue"),
    "library.given": ("read_log",),
    "library.heats": ("IdentifiedHeats",),
    "library.importing": ("extract_log", "import_log"),
    "library.looking_back": ("PublishedSteps", "past"),
    "library.machine": (
        "CalibrationResult",
        "DiscoveryResult",
        "LearnedParameters",
        "Machine",
        "discover",
        "load",
    ),
    "library.messages": (
        "ServiceAlarm",
        "ServiceAlarms",
        "ServiceField",
        "ServiceHealth",
        "ServiceHeat",
        "ServiceThermalError",
        "SourceHeat",
    ),
    "library.placing": ("PlacedSensors", "SensorPlaces"),
    "library.predicting": ("ForecastRun", "SimulatedRun"),
    "library.profiles": ("ReportGrid",),
    "library.replaying": ("Estimates",),
    "library.signals": ("SignalTable",),
    "library.steady": ("SteadyScrew",),
}


def __getattr__(name: str) -> object:
    """Load what is asked for."""
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - only who asks for it pays

        return version("ballscrew-observer")
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"observer.{module}"), name)
    raise AttributeError(f"module 'observer' has no attribute {name!r}", name=name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
