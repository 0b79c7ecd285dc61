"""The results of a fit, a search, a check and a ranking, as values of the library."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.report.wording import interval, unit_text


@dataclass(frozen=True, slots=True)
class FoundValue:
    """An estimated value, its unit, and its 95 % interval.

    Attributes:
        value: In `unit`.
        ci95: Lower and upper end of the interval, in `unit`.
        unit: As in the result's JSON, such as `W/m2K`; `1` for a pure number.
    """

    value: float
    ci95: tuple[float, float]
    unit: str

    def __str__(self) -> str:
        return f"{interval(self.value, *self.ci95)} {unit_text(self.unit)}".rstrip()


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """A physical effect that was named.

    Attributes:
        kind: Its name in `[[effect]]` of the configuration, such as `speed_convection`.
        target: The sensor, source or end where it acts; None for an effect of the whole machine.
        parameters: Its fitted parameters by their keys.
    """

    kind: str
    target: str | None
    parameters: Mapping[str, FoundValue]


def values_in(table: Mapping[str, Mapping[str, Any]]) -> dict[str, FoundValue]:
    """Return the values of a table with the keys `value`, `ci95` and `unit` in each entry."""
    return {key: FoundValue(v["value"], (v["ci95"][0], v["ci95"][1]), v["unit"]) for key, v in table.items()}


def effects_in(effects: Iterable[Mapping[str, Any]]) -> tuple[FoundEffect, ...]:
    """Return the effects of the list `effects` in `result.json`, in its order."""
    return tuple(FoundEffect(e["kind"], e["target"], values_in(e["parameters"])) for e in effects)


@dataclass(frozen=True, slots=True, repr=False)
class CheckFindings:
    """The findings of a check of a configuration; `findings["modes"]` is an entry of its document.

    Attributes:
        document: The output of `observer check --json`.
    """

    document: Mapping[str, Any]

    @property
    def usable(self) -> bool:
        """Whether an estimator can be designed; if not, the first warning is the reason."""
        return bool(self.document["verdict"]["usable"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings, a sentence each, with its remedy; empty for a configuration without doubts."""
        return tuple(self.document["warnings"])

    def __getitem__(self, key: str) -> Any:
        """An entry of the document."""
        return self.document[key]

    def __repr__(self) -> str:
        return "\n".join([self.document["verdict"]["text"], *self.warnings])

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(line)}</p>" for line in repr(self).splitlines())
