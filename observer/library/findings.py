"""The results of a fit, a search, a check and a ranking, as values of the library."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.report.wording import interval, unit_text


@dataclass(frozen=True, slots=True)
class FoundValue:
    """An estimated value, its unit, and its 95 % interval."""

    value: float
    ci95: tuple[float, float]
    unit: str

    def __str__(self) -> str:
        return f"{interval(self.value, *self.ci95)} {unit_text(self.unit)}".rstrip()


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """A physical effect that was named, where it is (None where it can be in one place only), and how
    strong.
    """

    kind: str
    target: str | None
    parameters: Mapping[str, FoundValue]


def values_in(table: Mapping[str, Mapping[str, Any]]) -> dict[str, FoundValue]:
    """The values of a document by their keys."""
    return {key: FoundValue(v["value"], (v["ci95"][0], v["ci95"][1]), v["unit"]) for key, v in table.items()}


def effects_in(effects: Iterable[Mapping[str, Any]]) -> tuple[FoundEffect, ...]:
    """The effects of a document."""
    return tuple(FoundEffect(e["kind"], e["target"], values_in(e["parameters"])) for e in effects)


@dataclass(frozen=True, slots=True, repr=False)
class CheckFindings:
    """The findings of a check of a configuration; `document` is the output of `observer check --json`."""

    document: Mapping[str, Any]

    @property
    def usable(self) -> bool:
        """Whether an estimator can be designed from it."""
        return bool(self.document["verdict"]["usable"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings, a sentence each."""
        return tuple(self.document["warnings"])

    def __getitem__(self, key: str) -> Any:
        """An entry of the document."""
        return self.document[key]

    def __repr__(self) -> str:
        return "\n".join([self.document["verdict"]["text"], *self.warnings])

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(line)}</p>" for line in repr(self).splitlines())
