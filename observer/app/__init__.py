"""The composition root of the commands for logs: one function for each."""

from observer.app.exports import export, export_table
from observer.app.logs import (
    HeatFiles,
    ImportOptions,
    compare,
    extract_log,
    forecast,
    identify,
    import_log,
    replay,
    simulate,
    simulate_steady,
)
from observer.app.models import discover, learned

__all__ = [
    "HeatFiles",
    "ImportOptions",
    "compare",
    "discover",
    "export",
    "export_table",
    "extract_log",
    "forecast",
    "identify",
    "import_log",
    "learned",
    "replay",
    "simulate",
    "simulate_steady",
]
