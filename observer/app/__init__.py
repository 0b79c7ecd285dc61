"""The composition root of the commands for logs: one function for each."""

from observer.app.exports import export, export_table
from observer.app.logs import (
    ImportOptions,
    extract_log,
    import_log,
)

__all__ = [
    "ImportOptions",
    "discover",
    "export",
    "export_table",
    "extract_log",
    "import_log",
    "learned",
]
