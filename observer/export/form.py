"""The intermediate form from which all code is written: inputs, outputs, constants, parts."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from observer.errors import ConfigError

Kind = Literal["real", "int", "bool"]
Role = Literal["input", "output", "state"]
Part = Callable[[Any, Any], None]
Values = Mapping[str, Any]
ZERO: Mapping[str, Any] = {"real": 0.0, "int": 0, "bool": False}


@dataclass(frozen=True, slots=True)
class Slot:
    """A number or array of the step, zero at first.

    `labels` name an array's elements. The `units` belong to these elements; a single one holds for all.

    Attributes:
        name: Its name in the parts, and in the code that is written.
        kind: `real`, `int` or `bool`.
        role: Whether it is set before a step, read after it, or private.
        text: What it holds, as a comment in the code; empty for state.
        shape: Empty for a single number. A slot with 0 in its shape is left out of the code.
        labels: One for each element of a one-dimensional array; empty if they have none.
        units: By element, or one for all; empty without a unit.
    """

    name: str
    kind: Kind
    role: Role
    text: str
    shape: tuple[int, ...] = ()
    labels: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def unit(self, at: int) -> str:
        """Return the unit of an element, empty for none.

        Args:
            at: The element's index; any for a single number.
        """
        if not self.units:
            return ""
        return self.units[at] if len(self.units) > 1 else self.units[0]


@dataclass(frozen=True, slots=True)
class Form:
    """A step at a fixed period, with everything in it.

    Attributes:
        name: “observer” or “model”.
        machine: The machine's name in the configuration.
        axis: The axis' name.
        digest: Identifies the configuration.
        version: The version of this program.
        period_s: The interval of the steps, in s.
        constants: Integers, floats and arrays of either, by name.
        slots: Inputs, outputs and state.
        parts: Functions of `algorithm` and `sequence`, run in this order.
        facts: Sentences for the engineer who builds it in.
    """

    name: str
    machine: str
    axis: str
    digest: str
    version: str
    period_s: float
    constants: Values
    slots: tuple[Slot, ...]
    parts: tuple[Part, ...]
    facts: tuple[str, ...] = field(default=())

    def of(self, role: Role) -> list[Slot]:
        """Return the slots of a role that have at least one element."""
        return [slot for slot in self.slots if slot.role == role and 0 not in slot.shape]

    @property
    def title(self) -> str:
        """One line that identifies the form."""
        return (
            f"{self.name} of {self.machine}, axis {self.axis}; period {self.period_s:g} s; configuration "
            f"{self.digest}; ballscrew-observer {self.version}"
        )


class FormRunner:
    """Runs a form in Python, one step a call: the reference for all other code.

    Attributes:
        form: The step.
        v: Every slot by name, as numbers and nested lists, all zero at first; each step changes it.
    """

    def __init__(self, form: Form) -> None:
        self.form = form
        self._c = SimpleNamespace(
            **{
                name: value.tolist() if isinstance(value, np.ndarray) else value
                for name, value in form.constants.items()
            }
        )
        self.v = SimpleNamespace(**{slot.name: _zeros(slot.shape, ZERO[slot.kind]) for slot in form.slots})

    def step(self, inputs: Values) -> dict[str, Any]:
        """Set the inputs and run one step.

        Args:
            inputs: New values by slot; a slot that is missing keeps its last value.

        Returns:
            Copies of the outputs by slot, as numbers and lists.
        """
        for name, value in inputs.items():
            setattr(self.v, name, list(value) if np.ndim(value) else value)
        for part in self.form.parts:
            part(self._c, self.v)
        outputs = ((slot.name, getattr(self.v, slot.name)) for slot in self.form.of("output"))
        return {name: list(value) if isinstance(value, list) else value for name, value in outputs}


def _zeros(shape: tuple[int, ...], zero: Any) -> Any:
    return zero if not shape else [_zeros(shape[1:], zero) for _ in range(shape[0])]


_WORDS = """
ABS ACTION AND ANY ARRAY AT AUTO BOOL BY BYTE CASE CONTINUE DATE DINT DO DOUBLE DWORD ELSE END ENUM EXIT EXP
FALSE FIND FLOAT FOR FUNCTION IF INT LEFT LEN LIMIT LINT LN LOG LREAL MAX METHOD MID MIN MOD MUX NOT OF ON OR
PROGRAM REAL REGISTER REPEAT RETURN RIGHT SEL SHORT SIGNED SINT SIZEOF STATIC STEP STRING STRUCT SWITCH TASK
THEN TIME TO TOD TRUE TRUNC TYPE UDINT UINT UNION UNTIL USINT VAR VOID WHILE WITH WORD XOR
"""
_RESERVED = frozenset(_WORDS.split())
"""Reserved words of C or structured text, in capitals."""


def identifiers(names: Sequence[str]) -> tuple[str, ...]:
    """Return names as identifiers of any language: letters, digits and single underscores.

    A name that begins with a digit or is a reserved word of C or structured text gets the prefix `in_`.

    Args:
        names: Names of channels, sensors or sources.

    Returns:
        As many identifiers, in the same order.

    Raises:
        ConfigError: If two different names become equal, capitals aside.
    """
    originals: dict[str, str] = {}
    identifiers_of_names = []
    for name in names:
        identifier = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9]", "_", name)).strip("_")
        if not identifier or identifier[0].isdigit() or identifier.upper() in _RESERVED:
            identifier = f"in_{identifier}"
        if (other := originals.setdefault(identifier.lower(), name)) != name:
            raise ConfigError(
                f'"{other}" and "{name}" are both "{identifier}" in a controller\'s language, which allows '
                "only letters, digits and _; rename one"
            )
        identifiers_of_names.append(identifier)
    return tuple(identifiers_of_names)
