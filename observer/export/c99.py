"""C99 from a form: a header and a source file, without a library, an allocation or a static that changes."""

from __future__ import annotations

import ast
import textwrap
from typing import Any, ClassVar

import numpy as np

from observer.export.dialect import Dialect, bare, indented
from observer.export.form import Form, Kind, Role, Slot

_TYPES: dict[Kind, str] = {"real": "real", "int": "int", "bool": "bool"}


class C99(Dialect):
    """Writes statements in C99.

    A slot is a member of the structures `in`, `out` and `s` that each function gets. Constants are static
    tables of the source file.

    Args:
        form: The step to write.
    """

    words: ClassVar = {ast.Eq: "==", ast.And: "&&", ast.Or: "||", ast.Not: "!"}

    def __init__(self, form: Form) -> None:
        super().__init__(form)
        pointers = {"input": "in", "output": "out", "state": "s"}
        self._where = {slot.name: f"{pointers[slot.role]}->{slot.name}" for slot in form.slots}

    def declare(self, name: str, kind: Kind, value: str) -> str:
        """Return the declaration of a local variable where it is first set."""
        return f"{_TYPES[kind]} {name} = {value};"

    def assign(self, target: str, value: str) -> str:
        """Return an assignment to a slot, an element or a local variable."""
        return f"{target} = {bare(value)};"

    def loop(self, name: str, first: int, end: int, body: list[str]) -> list[str]:
        """Return a loop from `first` to before `end`, whose variable is an `int` of the loop alone."""
        return [f"for (int {name} = {first}; {name} < {end}; {name}++) {{", *indented(body), "}"]

    def branch(self, test: str, body: list[str], other: list[str]) -> list[str]:
        """Return the lines of a condition; without `else` if `other` is empty."""
        lines = [f"if ({bare(test)}) {{", *indented(body)]
        return [*lines, "} else {", *indented(other), "}"] if other else [*lines, "}"]

    def literal(self, value: Any) -> str:
        """Return a number or a truth value; `R()` gives a real the chosen precision."""
        if isinstance(value, bool):
            return str(value).lower()
        return f"R({value!r})" if isinstance(value, float) else str(value)

    def local(self, name: str) -> str:
        """Return a local variable, whose name is unchanged."""
        return name

    def slot(self, name: str) -> str:
        """Return an input, an output or a state variable as a member of its structure."""
        return self._where[name]

    def constant(self, name: str) -> str:
        """Return a constant, whose name is unchanged."""
        return name

    def element(self, array: str, indices: list[str]) -> str:
        """Return an element of an array, one pair of brackets for each index."""
        return array + "".join(f"[{bare(index)}]" for index in indices)

    def call(self, name: str, arguments: list[str]) -> str:
        """Return a conversion for `real` and `int`, and a call of a static helper such as `abs_of` for other
        names.
        """
        inside = ", ".join(bare(argument) for argument in arguments)
        return f"({name})({inside})" if name in ("real", "int") else f"{name}_of({inside})"


def c99_files(form: Form) -> dict[str, str]:
    """Return the header and the source by their names.

    The source needs no library, allocates nothing and changes no static variable, so several states can be
    stepped side by side. The same arithmetic order as in Python gives equal results in double precision.

    Args:
        form: The step; its name prefixes all public names.

    Returns:
        The texts of `<name>.h` and `<name>.c`.
    """
    name = form.name
    dialect, parts = C99(form), dict[str, str]()
    for part in form.parts:
        text, lines = dialect.part(part.__name__)
        if lines:
            parts.setdefault(part.__name__, _function(name, part.__name__, text, lines))
    calls = [f"    {part.__name__}_part(s, in, out);" for part in form.parts if part.__name__ in parts]
    tables = [_table(key, value) for key, value in dialect.used.items()]
    helpers = "".join(text for key, text in _HELPERS.items() if any(key in body for body in parts.values()))
    source = f"""/* {form.title}
 * Written by `observer export`; change the configuration, not this file. */
#include "{name}.h"

typedef {name}_real real;
#define R(x) ((real)(x))

{"".join(tables)}
{helpers}
{"".join(parts.values())}void {name}_init({name}_state *s)
{{
    static const {name}_state zero = {{0}};
    *s = zero;
}}

void {name}_step({name}_state *s, const {name}_in *in, {name}_out *out)
{{
{chr(10).join(calls)}
}}
"""
    return {f"{name}.h": _header(form), f"{name}.c": source}


_HELPERS = {
    "abs_of(": "static real abs_of(real a) { return a < R(0.0) ? -a : a; }\n",
    "min_of(": "static real min_of(real a, real b) { return b < a ? b : a; }\n",
    "max_of(": "static real max_of(real a, real b) { return b > a ? b : a; }\n",
}


def _function(name: str, part: str, text: str, lines: list[str]) -> str:
    """Return the C function of one part, with its docstring as a comment."""
    body = "\n".join(indented(lines))
    first = "\n * ".join(text.splitlines())
    unused = [f"    (void){pointer};" for pointer, arrow in (("s", "s->"), ("in", "in->"), ("out", "out->"))
              if not _uses(body, arrow)]  # fmt: skip
    head = f"static void {part}_part({name}_state *s, const {name}_in *in, {name}_out *out)"
    return f"/* {first} */\n{head}\n{{\n{chr(10).join([*unused, body])}\n}}\n\n"


def _uses(body: str, arrow: str) -> bool:
    """Whether a function's body uses a pointer's target."""
    at = body.find(arrow)
    while at >= 0:
        if at == 0 or not (body[at - 1].isalnum() or body[at - 1] == "_"):
            return True
        at = body.find(arrow, at + 1)
    return False


def _table(name: str, value: Any) -> str:
    """Return the definition of a constant or an array of constants."""
    if not isinstance(value, np.ndarray):
        kind = "int" if isinstance(value, (int, np.integer)) else "real"
        return (
            f"static const {kind} {name} = {'R(' + repr(float(value)) + ')' if kind == 'real' else value};\n"
        )
    kind = "int" if np.issubdtype(value.dtype, np.integer) else "real"
    sizes = "".join(f"[{n}]" for n in value.shape)
    return f"static const {kind} {name}{sizes} = {_braced(value)};\n"


def _braced(value: np.ndarray) -> str:
    if value.ndim > 1:
        return "{\n" + ",\n".join(_braced(row) for row in value) + "}"
    whole = np.issubdtype(value.dtype, np.integer)
    numbers = ", ".join(str(int(x)) if whole else f"R({float(x)!r})" for x in value)
    return "{" + textwrap.fill(numbers, 106, break_long_words=False) + "}"


_STRUCTS: tuple[tuple[Role, str, str], ...] = (
    ("input", "in", "What a step is given."),
    ("output", "out", "What a step gives."),
    ("state", "state", "What is remembered from step to step, and worked on; its content is private."),
)


def _header(form: Form) -> str:
    """Return the header file: types, structures and the two functions."""
    name, guard = form.name, f"BALLSCREW_{form.name.upper()}_H"
    facts = "".join(f"\n * {line}" for fact in form.facts for line in textwrap.wrap(fact, 100))
    enums = "".join(_enum(name, slot) for role, _, _ in _STRUCTS for slot in form.of(role) if slot.labels)
    structs = "".join(
        f"/** {text} */\ntypedef struct {{\n{''.join(_member(name, slot) for slot in form.of(role))}}} "
        f"{name}_{short};\n\n"
        for role, short, text in _STRUCTS
    )
    return f"""/** @file
 * {form.title}{facts}
 * Written by `observer export`; change the configuration, not this file. */
#ifndef {guard}
#define {guard}

#include <stdbool.h>

/** Define {name.upper()}_SINGLE for single precision, in every file that includes this one. */
#ifdef {name.upper()}_SINGLE
typedef float {name}_real;
#else
typedef double {name}_real;
#endif

#define {name.upper()}_PERIOD_S {form.period_s!r}
#define {name.upper()}_CONFIGURATION "{form.digest}"
#define {name.upper()}_VERSION "{form.version}"

{enums}{structs}#ifdef __cplusplus
extern "C" {{
#endif

/** Set the state to that before the first step. */
void {name}_init({name}_state *s);

/** Take one step; call it every {form.period_s:g} s. Several states may be stepped side by side. */
void {name}_step({name}_state *s, const {name}_in *in, {name}_out *out);

#ifdef __cplusplus
}}
#endif
#endif
"""


def _enum(name: str, slot: Slot) -> str:
    """Return an enumeration of an array's indices by name, once for arrays with the same labels."""
    if slot.name in ("fresh", "error_um", "sensor_quality", "age_s"):
        return ""
    head = f"{name}_{slot.name}".upper()
    rows = "".join(
        f"    {head}_{label.upper().replace('.', '_').replace('-', 'M')} = {at},"
        f"{' /**< ' + slot.unit(at) + ' */' if slot.unit(at) else ''}\n"
        for at, label in enumerate(slot.labels)
    )
    return f"/** Elements of `{slot.name}`. */\nenum {{\n{rows}}};\n\n"


def _member(name: str, slot: Slot) -> str:
    """Return the declaration of one structure member, with its text and units as a comment."""
    kind = f"{name}_real" if slot.kind == "real" else _TYPES[slot.kind]
    sizes = "".join(f"[{n}]" for n in slot.shape)
    units = ", ".join(dict.fromkeys(unit for unit in slot.units if unit))
    text = f" /**< {slot.text}{', ' + units if units else ''} */" if slot.text else ""
    return f"    {kind} {slot.name}{sizes};{text}\n"
