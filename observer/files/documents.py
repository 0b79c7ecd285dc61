"""Results as JSON, for programs and people."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from observer.errors import UserError
from observer.process.terminal import readable_json


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a result as indented JSON with a final newline.

    Raises:
        UserError: A number in it is not finite; the sentence names its key.
    """
    path.write_text(result_text(document) + "\n", encoding="utf-8")


def result_text(document: Any) -> str:
    """Return a result as indented JSON.

    Raises:
        UserError: A number in it is not finite; the sentence names its key.
    """
    for place in _not_finite(document, ""):
        raise UserError(
            f"{place.removeprefix('.') or 'a number'} in the result is not a finite number; check the log "
            "and the configuration for values that are far too large"
        )
    return readable_json(document, indent=2)


def _not_finite(document: Any, place: str) -> Iterator[str]:
    """The places of numbers in a document that are not finite."""
    if isinstance(document, float):
        if not math.isfinite(document):
            yield place
    elif isinstance(document, Mapping):
        for key, value in document.items():
            yield from _not_finite(value, f"{place}.{key}")
    elif isinstance(document, list | tuple):
        for number, value in enumerate(document):
            yield from _not_finite(value, f"{place}[{number}]")
