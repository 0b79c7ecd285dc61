"""Which answers a test is to separate, for each verdict."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from observer.discovery import deciding
from observer.discovery.deciding import decisive_test
from observer.discovery.verdict import Verdict


def fit(name: str) -> Any:
    return SimpleNamespace(config=name, problem=SimpleNamespace(config=None))


def trial(name: str, drop: float, *, significant: bool = True) -> Any:
    candidate = SimpleNamespace(name=name, of=SimpleNamespace(can_exist=lambda _machine: True))
    return SimpleNamespace(candidate=candidate, drop=drop, significant=significant, fit=fit(f"with {name}"))


RANKING = (
    trial("lag", 90.0),
    trial("film", 80.0),
    trial("vague", 70.0, significant=False),
    trial("drift", 40.0),
)
FOUND = SimpleNamespace(null=fit("null"), fit=fit("both"), ranking=RANKING, blind=())


@pytest.fixture(autouse=True)
def answers_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answers themselves instead of a test."""
    monkeypatch.setattr(deciding, "propose", lambda _problem, answers, _pool: list(answers))


def asked_of(verdict: Verdict, partial: Any = None) -> Any:
    less = [("loss", fit("without loss")), ("body", fit("without body"))]
    return decisive_test(None, FOUND, verdict, less, partial)  # type: ignore[arg-type]


def test_of_an_ambiguous_answer_all_sets_are_distinguished() -> None:
    assert asked_of(Verdict("ambiguous", None, fits=(fit("a"), fit("b")))) == ["a", "b"]  # type: ignore[arg-type]


def test_of_what_is_unproved_the_answer_is_with_or_without_it() -> None:
    unproved = Verdict("unknown", None, unproved=("body",))  # type: ignore[arg-type]
    assert asked_of(unproved) == ["both", "without body"]


@pytest.mark.parametrize(("tied", "next_best"), [((), "with film"), (("lag", "film"), "with drift")])
def test_of_an_unknown_what_explains_most_stands_against_another_family_and_none(
    tied: tuple[str, ...], next_best: str
) -> None:
    tie = SimpleNamespace(members=[SimpleNamespace(name=name) for name in tied]) if tied else None
    partial = SimpleNamespace(trial=RANKING[0], tie=tie)
    unknown = Verdict("unknown", None, remains="on data held back")  # type: ignore[arg-type]
    assert asked_of(unknown, partial) == ["null", "with lag", next_best]


@pytest.mark.parametrize("kind", ["named", "none", "not_identifiable", "unknown"])
def test_no_test_is_proposed_where_nothing_is_to_be_distinguished(kind: Any) -> None:
    assert asked_of(Verdict(kind, None)) is None  # type: ignore[arg-type]


def test_logs_in_doubt_are_to_be_corrected_first() -> None:
    doubted = Verdict("unknown", None, unproved=("body",), suspected=("late",))  # type: ignore[arg-type]
    assert asked_of(doubted) is None
