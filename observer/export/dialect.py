"""Translates the parts of a form to another language: the traversal shared by all dialects.

Conditions on constants and empty loops are resolved when the code is written.
"""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from observer.export.form import Form, Kind
from observer.export.subset import FUNCTIONS, Subset, base, called

_SIGNS: dict[type[ast.AST], str] = {
    ast.Gt: ">", ast.GtE: ">=", ast.Lt: "<", ast.LtE: "<=", ast.Add: "+", ast.Sub: "-", ast.Mult: "*",
    ast.Div: "/", ast.FloorDiv: "/", ast.USub: "-",
}  # fmt: skip


class Dialect(Subset, ABC):
    """Writes the parts of a form in one language; `used` are the constants that they name.

    The signs that differ between languages are in `words`.

    A subclass gives the syntax of its language, one method for each kind of statement or name.

    Args:
        form: The step to write.

    Attributes:
        used: Constants named by the code so far, with their values; the caller declares only these.
    """

    words: ClassVar[Mapping[type[ast.AST], str]]

    def __init__(self, form: Form) -> None:
        super().__init__(form)
        self.used: dict[str, Any] = {}
        self._signs = {**_SIGNS, **self.words}
        self._writers: dict[type[ast.AST], Callable[[Any], str]] = {
            ast.Name: lambda node: self.local(node.id),
            ast.Subscript: self._element,
            ast.Attribute: self._named,
            ast.BinOp: lambda node: self._pair(node.left, node.op, node.right),
            ast.Compare: lambda node: self._pair(node.left, node.ops[0], node.comparators[0]),
            ast.UnaryOp: lambda node: f"({self._signs[type(node.op)]}{self.expression(node.operand)})",
            ast.BoolOp: self._all,
            ast.Call: lambda node: self.call(called(node), [self.expression(a) for a in node.args]),
        }

    def part(self, name: str) -> tuple[str, list[str]]:
        """Return the docstring and the lines of a part.

        Args:
            name: The name of a function of `algorithm` or `sequence`.

        Returns:
            The lines are empty if all statements are on constants that exclude them, such as loops without a
            turn.
        """
        function = FUNCTIONS[name]
        return ast.get_docstring(function) or "", self.block(function.body)

    def block(self, statements: Sequence[ast.stmt]) -> list[str]:
        """Return the lines of some statements, without indentation."""
        return [line for statement in statements for line in self.statement(statement)]

    def statement(self, node: ast.stmt) -> list[str]:
        """Return the lines of a statement; a docstring has none.

        Allowed are loops over `range`, conditions, declarations with a value, and assignments. Another
        statement fails an assertion, since it is a defect of the part.
        """
        if isinstance(node, ast.For):
            return self._loop(node)
        if isinstance(node, ast.If):
            return self._if(node)
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            name, kind = self.declared(node)
            return [self.declare(name, kind, self.expression(node.value))]
        if isinstance(node, ast.Assign):
            return [self.assign(self.expression(node.targets[0]), self.expression(node.value))]
        if isinstance(node, ast.AugAssign):
            value = self._pair(node.target, node.op, node.value)
            return [self.assign(self.expression(node.target), value)]
        assert isinstance(node, ast.Expr), ast.unparse(node)
        return []

    def _loop(self, node: ast.For) -> list[str]:
        first, end = self.turns(node)
        if first >= end:
            return []
        name, _ = self.declared(node)
        return self.loop(name, first, end, self.block(node.body))

    def _if(self, node: ast.If) -> list[str]:
        constant = self.constant_value(node.test)
        if constant is not None:
            return self.block(node.body if constant else node.orelse)
        return self.branch(self.expression(node.test), self.block(node.body), self.block(node.orelse))

    def expression(self, node: ast.expr) -> str:
        """Return an expression, in parentheses if it has an operator. Expressions of integer constants are
        evaluated.
        """
        constant = self.constant_value(node)
        return self._writers[type(node)](node) if constant is None else self.literal(constant)

    def _pair(self, left: ast.expr, sign: ast.AST, right: ast.expr) -> str:
        return f"({self.expression(left)} {self._signs[type(sign)]} {self.expression(right)})"

    def _all(self, node: ast.BoolOp) -> str:
        return "(" + f" {self._signs[type(node.op)]} ".join(map(self.expression, node.values)) + ")"

    def _element(self, node: ast.Subscript) -> str:
        indices, array = [self.expression(node.slice)], node.value
        while isinstance(array, ast.Subscript):
            indices.insert(0, self.expression(array.slice))
            array = array.value
        return self.element(self.expression(array), indices)

    def _named(self, node: ast.Attribute) -> str:
        if base(node) == "v":
            return self.slot(node.attr)
        self.used[node.attr] = self.form.constants[node.attr]
        return self.constant(node.attr)

    @abstractmethod
    def declare(self, name: str, kind: Kind, value: str) -> str:
        """Return the declaration of a local variable where it is first set.

        Args:
            name: The variable's name in Python.
            kind: Its kind.
            value: Its first value, already translated.
        """

    @abstractmethod
    def assign(self, target: str, value: str) -> str:
        """Return an assignment; both sides are already translated."""

    @abstractmethod
    def loop(self, name: str, first: int, end: int, body: list[str]) -> list[str]:
        """Return a loop from `first` to before `end`.

        Args:
            name: The variable's name in Python.
            first: Its first value.
            end: The value before which it ends; above `first`.
            body: The translated statements.
        """

    @abstractmethod
    def branch(self, test: str, body: list[str], other: list[str]) -> list[str]:
        """Return a condition.

        Args:
            test: The translated condition.
            body: Statements if it is true.
            other: Statements if it is false; may be empty.
        """

    @abstractmethod
    def literal(self, value: Any) -> str:
        """Return a number or a truth value, so that reading it back gives the same bits."""

    @abstractmethod
    def local(self, name: str) -> str:
        """Return a local variable."""

    @abstractmethod
    def slot(self, name: str) -> str:
        """Return an input, an output or a state variable."""

    @abstractmethod
    def constant(self, name: str) -> str:
        """Return a constant; it is in `used` from now on."""

    @abstractmethod
    def element(self, array: str, indices: list[str]) -> str:
        """Return an element of an array, from its translated name and indices."""

    @abstractmethod
    def call(self, name: str, arguments: list[str]) -> str:
        """Return a call of `abs`, `min`, `max`, `int` or `real`; the latter two convert."""


def bare(text: str) -> str:
    """Return the text without parentheses around the whole.

    `(a + b)` becomes `a + b`, and `(a) + (b)` stays.
    """
    depth = 0
    for at, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return text[1:-1] if at == len(text) - 1 and text[0] == "(" else text
    return text


def indented(lines: Sequence[str]) -> list[str]:
    """Return the lines, indented by one level."""
    return [f"    {line}" for line in lines]
