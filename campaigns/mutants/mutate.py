"""The mutants of a module: cosmic-ray's operators at every place where they change what the code does."""

from __future__ import annotations

import difflib
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

_ARITHMETIC = "Add|Sub|Mul|Div"
# What is left out fails wherever it is run (`a << b` of two floats), or is the same in another notation.
_USED = re.compile(
    rf"core/(?:ReplaceBinaryOperator_(?:(?:{_ARITHMETIC}|FloorDiv|Mod|Pow)_(?:{_ARITHMETIC})|BitAnd_BitOr|BitOr_BitAnd)"
    r"|ReplaceComparisonOperator_(?:(?:Eq|NotEq|Lt|LtE|Gt|GtE)_(?:Eq|NotEq|Lt|LtE|Gt|GtE)|Is_IsNot|IsNot_Is)"
    r"|ReplaceUnaryOperator_(?:USub_UAdd|Delete_\w+)|AddNot|Replace(?:True|False|And|Or|Break|Continue)With\w+"
    r"|NumberReplacer|ZeroIterationForLoop)"
)


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: cosmic-ray's operator, which of its places in the module, and the line of that."""

    module: str
    operator: str
    occurrence: int
    line: int


def mutants_of(module: str, source: str) -> Iterator[Mutant]:
    """Every mutant of a module."""
    tree = get_ast(source)
    for name in operator_names():
        if not _USED.fullmatch(name):
            continue
        operator = get_operator(name)()
        places = [(node, start) for node in ast_nodes(tree) for start, _ in operator.mutation_positions(node)]
        for occurrence, (node, start) in enumerate(places):
            if not _says_nothing(node):
                yield Mutant(module, name.removeprefix("core/"), occurrence, start[0])


def mutated(source: str, mutant: Mutant) -> str:
    """The module's source with the change."""
    made: str | None = mutate_code(source, get_operator(f"core/{mutant.operator}")(), mutant.occurrence)
    if made is None:
        raise ValueError(f"{mutant.operator} has no place number {mutant.occurrence}")
    return made


def sample(mutants: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """So many of them, the same ones for the same seed, in the order of the file."""
    if count < len(mutants):
        mutants = random.Random(f"{seed} {mutants[0].module}").sample(mutants, count)
    return sorted(mutants, key=lambda m: (m.line, m.operator, m.occurrence))


def _says_nothing(node: Any) -> bool:
    """Whether a node is part of a decorator, an annotation or `strict=`: no run of the program reads it."""
    while node.parent is not None:
        child, node = node, node.parent
        match node.type:
            case "decorator":
                return True
            case "tfpdef" | "annassign" if node.children.index(child) in (1, 2):
                return bool(node.type == "tfpdef" or node.children.index(child) == 1)
            case "funcdef" if node.annotation is child:
                return True
            case "argument" if node.children[0].get_code().strip() == "strict":
                return True
    return False


def change(before: str, after: str) -> str:
    """The lines that differ: as they were → as they are."""
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=0)
    changed = [line for line in lines if line[:3] not in ("---", "+++") and line[0] in "-+"]
    old, new = (" ".join(line[1:].strip() for line in changed if line[0] == sign) for sign in "-+")
    return f"{old} → {new}"
