"""Runs structured text by its parsed tree: every node becomes a piece of Python, and types must agree.

What a strict compiler refuses is refused here, too: names that are not declared, an index that is no DINT,
DINT and LREAL in one expression, an assignment between types.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import tree_sitter
import tree_sitter_iec61131_3_st as grammar

_OPERATORS = {
    ":=": "=", "=": "==", "<>": "!=", "AND": "and", "OR": "or", "+": "+", "-": "-", "*": "*", "<": "<",
    ">": ">", "<=": "<=", ">=": ">=",
}  # fmt: skip
_ZERO = {"LREAL": 0.0, "REAL": 0.0, "DINT": 0, "BOOL": False}
_CALLS = {"ABS": "abs", "MIN": "_min", "MAX": "_max", "TRUNC": "int"}


def parsed(text: str) -> tree_sitter.Node:
    return tree_sitter.Parser(tree_sitter.Language(grammar.language())).parse(text.encode()).root_node


def words(node: tree_sitter.Node) -> str:
    assert node.text is not None
    return node.text.decode()


def children(node: tree_sitter.Node, field: str) -> list[tree_sitter.Node]:
    return [child for child in node.children_by_field_name(field) if child.is_named]


class Block:
    """A function block: `inputs`, `outputs` by name, and a step."""

    def __init__(self, text: str) -> None:
        root = parsed(text)
        assert not root.has_error
        (self._block,) = (n for n in root.children if n.type == "function_block_declaration")
        self.types: dict[str, str] = {}
        self.values: dict[str, Any] = {}
        self.inputs, self.outputs = list[str](), list[str]()
        for section in self._block.children:
            for one in section.children if section.type in ("var_input", "var_output", "var_block") else ():
                if one.type == "variable_declaration":
                    self._declare(section.type, one)
        code = [line for node in children(self._block, "body") for line in self.statement(node)]
        space: dict[str, Any] = {
            "_at": _at,
            "_min": lambda a, b: b if b < a else a,
            "_max": lambda a, b: b if b > a else a,
        }
        exec("\n".join(["def step(v):", *(f" {line}" for line in code)]), space)
        self._step: Callable[[dict[str, Any]], None] = space["step"]

    def _declare(self, section: str, node: tree_sitter.Node) -> None:
        (name,), (kind,) = children(node, "names"), children(node, "type")
        key = words(name).lower()
        assert key not in self.types, f"{key} is declared twice"
        given = children(node, "initial_value")
        numbers = [self._constant(n) for n in given]
        if kind.type == "array_type":
            self.types[key] = words(children(kind, "element_type")[0])
            ranges = [
                [int(words(children(r, end)[0])) for end in ("lower", "upper")]
                for r in kind.children
                if r.type == "subrange"
            ]
            assert all(low == 0 for low, _ in ranges)
            sizes = [high + 1 for _, high in ranges]
            self.values[key] = _shaped(numbers, sizes, _ZERO[self.types[key]])
        else:
            self.types[key] = words(kind)
            self.values[key] = numbers[0] if numbers else _ZERO[words(kind)]
        {"var_input": self.inputs, "var_output": self.outputs}.get(section, []).append(key)

    @staticmethod
    def _constant(node: tree_sitter.Node) -> Any:
        return {"integer_literal": int, "real_literal": float}[node.type](words(node))

    def step(self, inputs: dict[str, Any]) -> dict[str, Any]:
        for name, value in inputs.items():
            assert name.lower() in self.inputs, name
            self.values[name.lower()] = value
        self._step(self.values)
        return {name: self.values[name] for name in self.outputs}

    def statement(self, node: tree_sitter.Node) -> list[str]:
        if node.type == "assignment_statement":
            (left, to), (right, of) = (self.expression(children(node, side)[0]) for side in ("left", "right"))
            assert to == of, f"{words(node)}: {of} to {to}"
            return [f"{left} = {right}"]
        if node.type == "for_statement":
            name, start, end = (self.expression(children(node, f)[0]) for f in ("control", "start", "end"))
            assert name[1] == start[1] == end[1] == "DINT"
            return [f"for {name[0]} in range({start[0]}, {end[0]} + 1):", *self._body(node, "body")]
        if node.type == "if_statement":
            test, kind = self.expression(children(node, "condition")[0])
            assert kind == "BOOL"
            lines = [f"if {test}:", *self._body(node, "consequence")]
            for other in node.children:
                if other.type == "else_clause":
                    lines += ["else:", *self._body(other, "body")]
            return lines
        assert node.type in ("empty_statement", "comment"), node.type
        return []

    def _body(self, node: tree_sitter.Node, field: str) -> list[str]:
        return [" pass", *(f" {line}" for n in children(node, field) for line in self.statement(n))]

    def expression(self, node: tree_sitter.Node) -> tuple[str, str]:  # noqa: PLR0911
        """Python for an expression, and its type."""
        if node.type == "identifier":
            key = words(node).lower()
            return f'v["{key}"]', self.types[key]
        if node.type == "index_expression":
            code, kind = self.expression(children(node, "object")[0])
            for index in children(node, "index"):
                at, whole = self.expression(index)
                assert whole == "DINT", words(node)
                code += f"[{at}]" if index.type in ("identifier", "integer_literal") else f"[_at({at})]"
            return code, kind
        if node.type == "binary_expression":
            return self._pair(node)
        if node.type == "parenthesized_expression":
            code, kind = self.expression(node.named_children[0])
            return f"({code})", kind
        if node.type == "unary_expression":
            code, kind = self.expression(children(node, "operand")[0])
            sign = words(node.children[0]).strip()
            assert sign == "-" or kind == "BOOL"
            return f"({'not ' if sign == 'NOT' else sign}{code})", kind
        if node.type == "call_expression":
            return self._call(node)
        if node.type == "boolean_literal":
            return words(node).capitalize(), "BOOL"
        return words(node), "DINT" if node.type == "integer_literal" else "LREAL"

    def _pair(self, node: tree_sitter.Node) -> tuple[str, str]:
        (left, one), (right, other) = (self.expression(children(node, side)[0]) for side in ("left", "right"))
        sign = words(node.child_by_field_name("operator"))  # type: ignore[arg-type]
        assert one == other, f"{words(node)}: {one} and {other}"
        if sign == "/":
            return f"({left} {'//' if one == 'DINT' else '/'} {right})", one
        logic = sign in ("AND", "OR", "=", "<>", "<", ">", "<=", ">=")
        assert sign not in ("AND", "OR") or one == "BOOL"
        return f"({left} {_OPERATORS[sign]} {right})", "BOOL" if logic else one

    def _call(self, node: tree_sitter.Node) -> tuple[str, str]:
        name = words(children(node, "function")[0]).upper()
        (given,) = children(node, "arguments")
        codes, kinds = zip(*(self.expression(n) for n in given.named_children), strict=True)
        if name == "DINT_TO_LREAL":
            assert kinds == ("DINT",)
            return f"float({codes[0]})", "LREAL"
        assert set(kinds) == {"LREAL"}, words(node)
        return f"{_CALLS[name]}({', '.join(codes)})", "DINT" if name == "TRUNC" else "LREAL"


def _at(index: int) -> int:
    assert index >= 0, "an index below its array"
    return index


def _shaped(numbers: list[Any], sizes: list[int], zero: Any) -> Any:
    total = 1
    for size in sizes:
        total *= size
    assert len(numbers) in (0, total)
    numbers = numbers or [zero] * total
    for size in reversed(sizes[1:]):
        numbers = [numbers[i : i + size] for i in range(0, len(numbers), size)]
    return numbers
