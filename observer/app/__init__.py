"""The composition root of the commands for logs: one function for each."""

from observer.app.logs import (
    ImportOptions,
    extract_log,
    import_log,
)

__all__ = [
    "ImportOptions",
    "discover",
    "extract_log",
    "import_log",
    "learned",
]
