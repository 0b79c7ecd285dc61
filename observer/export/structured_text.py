"""IEC 61131-3 structured text from a form: one function block that every edition of the standard allows.

The language is not case-sensitive and a block has a single name space. So state variables begin with `s_`,
variables local to a part with `t_`, constants with `c_`.
"""

from __future__ import annotations

import ast
import textwrap
from collections import Counter
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from observer.errors import ConfigError
from observer.export.dialect import Dialect, bare, indented
from observer.export.form import Form, Kind, Slot
from observer.export.subset import kind_of

_SINGLY = ("reading", "fresh")
"""Arrays of which each element is an input with a name of its own."""
_FUNCTIONS = {"abs": "ABS", "min": "MIN", "max": "MAX", "int": "TRUNC"}


class StructuredText(Dialect):
    """Writes statements in structured text, with reals of one type.

    Args:
        form: The step to write.
        real: `LREAL` for double or `REAL` for single precision.
    """

    words: ClassVar = {ast.Eq: "=", ast.And: "AND", ast.Or: "OR", ast.Not: "NOT "}

    def __init__(self, form: Form, real: str) -> None:
        super().__init__(form)
        self._real = real
        outside = {slot.name for slot in (*form.of("output"), *form.of("input")) if slot.name not in _SINGLY}
        self._names = {s.name: s.name if s.name in outside else f"s_{s.name}" for s in form.slots}

    def declare(self, name: str, kind: Kind, value: str) -> str:  # noqa: ARG002
        """Return an assignment, since variables are declared at the top of the block."""
        return self.assign(self.local(name), value)

    def assign(self, target: str, value: str) -> str:
        """Return an assignment to a slot, an element or a local variable."""
        return f"{target} := {bare(value)};"

    def loop(self, name: str, first: int, end: int, body: list[str]) -> list[str]:
        """Return a loop from `first` to before `end`; the language's upper limit is included, so it is `end`
        − 1.
        """
        return [f"FOR {self.local(name)} := {first} TO {end - 1} DO", *indented(body), "END_FOR;"]

    def branch(self, test: str, body: list[str], other: list[str]) -> list[str]:
        """Return the lines of a condition; without `ELSE` if `other` is empty."""
        lines = [f"IF {bare(test)} THEN", *indented(body)]
        return [*lines, *(["ELSE", *indented(other)] if other else []), "END_IF;"]

    def literal(self, value: Any) -> str:
        """Return a number or a truth value; a real always has a decimal point."""
        return _number(value)

    def local(self, name: str) -> str:
        """Return a part's local variable."""
        return f"t_{name}"

    def slot(self, name: str) -> str:
        """Return an input or output by its name, and a state variable with the prefix `s_`."""
        return self._names[name]

    def constant(self, name: str) -> str:
        """Return a constant with the prefix `c_`."""
        return f"c_{name}"

    def element(self, array: str, indices: list[str]) -> str:
        """Return an element of an array, all indices in one pair of brackets."""
        return f"{array}[{', '.join(map(bare, indices))}]"

    def call(self, name: str, arguments: list[str]) -> str:
        """Return a call of a standard function; `int` truncates, and `real` converts from `DINT`."""
        function = _FUNCTIONS.get(name, f"DINT_TO_{self._real}")
        return f"{function}({', '.join(map(bare, arguments))})"

    def taken(self) -> list[str]:
        """Return every name in use once all parts are written, except those of single inputs.

        The caller compares them with the names of inputs, since the block has one name space.
        """
        return [*self._names.values(), *map(self.local, self.locals), *map(self.constant, self.used)]

    def types(self, kind: Kind, shape: tuple[int, ...]) -> str:
        """Return the name of a type.

        Args:
            kind: The kind of a number, or of an array's elements.
            shape: The array's shape; empty for a single number. Indices begin at 0.
        """
        scalar = {"real": self._real, "int": "DINT", "bool": "BOOL"}[kind]
        sizes = ", ".join(f"0..{n - 1}" for n in shape)
        return f"ARRAY[{sizes}] OF {scalar}" if shape else scalar


def _number(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return str(value).upper()
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    mantissa, _, exponent = repr(float(value)).partition("e")
    point = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{point}E{int(exponent)}" if exponent else point


def structured_text(form: Form, real: str = "LREAL") -> str:
    """Return a form as the text of a function block.

    Args:
        form: The step.
        real: The type of its reals, `LREAL` or `REAL`.

    Raises:
        ConfigError: If two names differ at most in capitals.
    """
    dialect = StructuredText(form, real)
    body = []
    for part in form.parts:
        text, lines = dialect.part(part.__name__)
        body += ["", *(f"(* {line} *)" for line in text.splitlines() if line), *lines] if lines else []
    arrays = [slot for slot in form.of("input") if slot.name in _SINGLY]
    inputs = [(slot, at, name) for slot in arrays for at, name in enumerate(_names_of(slot))]
    assignments = [f"{dialect.slot(slot.name)}[{at}] := {name};" for slot, at, name in inputs]
    _refuse_twice([*(name for _, _, name in inputs), *dialect.taken()])
    blocks = (
        ("VAR_INPUT", [_declared(name, dialect.types(slot.kind, ()), slot.text, slot.unit(at))
                       for slot, at, name in inputs]
         + [_slot(dialect, slot) for slot in form.of("input") if slot.name not in _SINGLY]),
        ("VAR_OUTPUT", [_slot(dialect, slot) for slot in form.of("output")]),
        ("VAR", [_slot(dialect, slot) for slot in (*arrays, *form.of("state"))]
         + [f"{dialect.local(name)} : {dialect.types(kind, ())};" for name, kind in dialect.locals.items()]),
        ("VAR CONSTANT", [_constant(dialect, name, value) for name, value in dialect.used.items()]),
    )  # fmt: skip
    facts = "\n".join(f"   {line}" for fact in form.facts for line in textwrap.wrap(fact, 110))
    declared = "".join(f"{head}\n{chr(10).join(indented(lines))}\nEND_VAR\n" for head, lines in blocks)
    code = "\n".join(indented([*assignments, *body]))
    return (
        f"(* {form.title}\n{facts}\n"
        "   Written by `observer export`; change the configuration, not this text. *)\n"
        f"FUNCTION_BLOCK {block_name(form)}\n{declared}\n{code}\nEND_FUNCTION_BLOCK\n"
    )


def _refuse_twice(names: Sequence[str]) -> None:
    """Raise `ConfigError` if two names differ at most in capitals."""
    twice = [name for name, count in Counter(name.lower() for name in names).items() if count > 1]
    if twice:
        raise ConfigError(
            f'"{twice[0]}" would stand for two things in structured text, which is not case-sensitive; '
            "rename the channel"
        )


def block_name(form: Form) -> str:
    """Return the name of the function block: FB_BallscrewObserver or FB_BallscrewModel."""
    return f"FB_Ballscrew{form.name.capitalize()}"


def _names_of(slot: Slot) -> tuple[str, ...]:
    return slot.labels if slot.name == "reading" else tuple(f"{label}_{slot.name}" for label in slot.labels)


def _slot(dialect: StructuredText, slot: Slot) -> str:
    label = f"{slot.text}: {', '.join(slot.labels)}" if slot.labels else slot.text
    return _declared(dialect.slot(slot.name), dialect.types(slot.kind, slot.shape), label, slot.unit(0))


def _declared(name: str, kind: str, text: str, unit: str) -> str:
    words = ", ".join(filter(None, (text, unit)))
    comment = "\n".join(textwrap.wrap(f"(* {words} *)", 106)) if text else ""
    return f"{name} : {kind};" + (f" {comment}" if comment else "")


def _constant(dialect: StructuredText, name: str, value: Any) -> str:
    kind = dialect.types(kind_of(value), np.shape(value))
    numbers = [_number(x) for x in np.ravel(value)]
    if not np.ndim(value):
        return f"c_{name} : {kind} := {numbers[0]};"
    return f"c_{name} : {kind} := [\n" + textwrap.fill(", ".join(numbers), 106) + "];"
