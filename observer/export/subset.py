"""Static analysis of the parts of a form, before they are written in any language."""

from __future__ import annotations

import ast
import inspect
import operator
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from observer.export import algorithm, sequence
from observer.export.form import Form, Kind

FUNCTIONS = {
    node.name: node
    for module in (algorithm, sequence)
    for node in ast.parse(inspect.getsource(module)).body
    if isinstance(node, ast.FunctionDef)
}
KINDS: dict[str, Kind] = {"float": "real", "int": "int", "bool": "bool"}
_FOLDABLE: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Eq: operator.eq,
    ast.Add: operator.add, ast.Sub: operator.sub,
}  # fmt: skip


class Subset:
    """Kinds and constants in the parts of a form; `locals` are the variables of the parts visited so far.

    Args:
        form: The step, whose constants and slots give kinds and sizes.

    Attributes:
        kinds: The kind of each slot by name.
        locals: The kind of each local variable.
    """

    def __init__(self, form: Form) -> None:
        self.form = form
        self.kinds: dict[str, Kind] = {slot.name: slot.kind for slot in form.slots}
        self.locals: dict[str, Kind] = {}

    def declared(self, node: ast.AnnAssign | ast.For) -> tuple[str, Kind]:
        """Return the variable that a statement declares, and its kind.

        A name must have the same kind in all parts; otherwise an assertion fails. Loop variables are
        integers.
        """
        assert isinstance(node.target, ast.Name)
        kind: Kind = "int"
        if isinstance(node, ast.AnnAssign):
            kind = KINDS[ast.unparse(node.annotation)]
        assert self.locals.setdefault(node.target.id, kind) == kind, f"{node.target.id} has two kinds"
        return node.target.id, kind

    def turns(self, node: ast.For) -> tuple[int, int]:
        """Return the first index and the end of a loop over `range`, whose bounds are constants."""
        assert isinstance(node.iter, ast.Call)
        bounds = [self.constant_value(argument) for argument in node.iter.args]
        assert all(isinstance(bound, int) for bound in bounds), ast.unparse(node.iter)
        return (0, bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])

    def constant_value(self, node: ast.expr) -> Any:
        """Return the value of an expression of integer constants or literals; None for any other.

        Comparisons, sums and differences of such constants are evaluated. A constant that the form lacks
        counts as 0, so that its loops vanish.
        """
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Attribute) and base(node) == "c":
            value = self.form.constants.get(node.attr, 0)
            return value if isinstance(value, int) else None
        if isinstance(node, ast.Compare):
            of, sign, to = node.left, node.ops[0], node.comparators[0]
        elif isinstance(node, ast.BinOp):
            of, sign, to = node.left, node.op, node.right  # type: ignore[assignment]
        else:
            return None
        left, right = self.constant_value(of), self.constant_value(to)
        whole = isinstance(left, int) and isinstance(right, int)
        return _FOLDABLE[type(sign)](left, right) if whole and type(sign) in _FOLDABLE else None

    def kind(self, node: ast.expr) -> Kind:
        """Return the kind of an expression. Its local variables must have been visited."""
        kind: Kind = "bool"
        if isinstance(node, ast.Constant):
            kind = KINDS[type(node.value).__name__]
        elif isinstance(node, ast.Name):
            kind = self.locals[node.id]
        elif isinstance(node, ast.Subscript):
            kind = self.kind(node.value)
        elif isinstance(node, ast.Attribute):
            kind = self.kinds[node.attr] if base(node) == "v" else kind_of(self.form.constants[node.attr])
        elif isinstance(node, ast.BinOp):
            kind = "real" if "real" in (self.kind(node.left), self.kind(node.right)) else "int"
        elif isinstance(node, ast.Call):
            kind = "int" if called(node) == "int" else "real"
        return kind


def base(node: ast.Attribute) -> str:
    """Return the record in which a name is looked up: `c` for constants, `v` for slots."""
    assert isinstance(node.value, ast.Name)
    return node.value.id


def called(node: ast.Call) -> str:
    """Return the name of the called function."""
    assert isinstance(node.func, ast.Name)
    return node.func.id


def kind_of(value: Any) -> Kind:
    """Return the kind of a constant.

    Arrays have the kind of their elements.
    """
    return "int" if np.issubdtype(np.asarray(value).dtype, np.integer) else "real"


_NAMES: dict[type[ast.AST], str] = {
    ast.Add: "adds", ast.Sub: "adds", ast.Mult: "multiplies", ast.Div: "divides",
}  # fmt: skip


class OperationCount(Subset):
    """Counts a step's operations on reals, with the longer branch of each condition."""

    def count(self) -> Counter[str]:
        """Return the largest number of `adds`, `multiplies`, `divides` and `compares` of a step.

        Absolute values, minima and maxima count as compares. Operations on integers are not counted.
        """
        return sum((self._of(FUNCTIONS[part.__name__].body) for part in self.form.parts), Counter[str]())

    def _of(self, statements: Sequence[ast.stmt]) -> Counter[str]:
        """Return the number of each operation in statements; the body of a loop counts once for each turn."""
        total: Counter[str] = Counter()
        for node in statements:
            if isinstance(node, ast.For):
                self.declared(node)
                first, end = self.turns(node)
                body = self._of(node.body) if end > first else Counter[str]()
                total += Counter({key: (end - first) * n for key, n in body.items()})
            elif isinstance(node, ast.If):
                total += self._of_branch(node)
            else:
                if isinstance(node, ast.AnnAssign):
                    self.declared(node)
                total += self._of_expressions(node)
        return total

    def _of_branch(self, node: ast.If) -> Counter[str]:
        constant = self.constant_value(node.test)
        if constant is not None:
            return self._of(node.body if constant else node.orelse)
        ways = [self._of(node.body), self._of(node.orelse)]
        return self._of_expressions(node.test) + max(ways, key=lambda way: way.total())

    def _of_expressions(self, node: ast.AST) -> Counter[str]:
        operations: Counter[str] = Counter()
        for part in ast.walk(node):
            if isinstance(part, (ast.BinOp, ast.AugAssign)):
                left = part.left if isinstance(part, ast.BinOp) else part.target
                operations[_NAMES.get(type(part.op), "")] += self.kind(left) == "real"
            elif isinstance(part, ast.Compare):
                operations["compares"] += self.kind(part.left) == "real"
            elif isinstance(part, ast.Call):
                operations["compares"] += called(part) in ("abs", "min", "max")
        return operations
