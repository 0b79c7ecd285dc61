"""Which answers a test is to separate, for each verdict."""

from __future__ import annotations

from typing import Any

import pytest

from observer.discovery import deciding
from observer.discovery.deciding import decisive_test
from observer.discovery.family import Tie
from observer.discovery.search import FittedCandidate, Search
from observer.discovery.verdict import Partial, Verdict
from observer.fit.hypothesis import Fit
from tests.discovery.written import estimated, left, trial


def answer(offset_K: float) -> Fit:
    """A fit that is told from others by its configuration."""
    return left(0.3, {"kind": "sensor_bias", "target": "a", "offset_K": offset_K})


NULL, BOTH, WITHOUT_LOSS, WITHOUT_BODY = (answer(offset_K) for offset_K in (0.0, 0.1, 0.2, 0.3))
LAG, FILM, DRIFT = (
    trial(name, drop, answer(drop)) for name, drop in (("lag", 0.9), ("film", 0.8), ("drift", 0.4))
)
VAGUE = FittedCandidate(
    LAG.candidate._replace(target="a", fitted={"offset_K": LAG.candidate.of.parameters["offset_K"]}),
    estimated(answer(0.7).config, [0.7], [0.8], [(0, "offset_K")]), 0.95, 0.0, 0.5,
)  # fmt: skip
UNKNOWN = Verdict("unknown", NULL, remains="on data held back")
FOUND = Search(NULL, BOTH, (), (), (VAGUE, LAG, FILM, DRIFT), (), ())


def partial(*tied: FittedCandidate) -> Partial:
    tie = Tie(tuple(t.candidate for t in tied)) if tied else None
    return Partial(LAG, 0.5, 1.0, 1.0, "a", None, tie, 0, (1.0, 0.5), None)


@pytest.mark.parametrize(
    ("verdict", "of_unknown", "asked"),
    [
        (Verdict("ambiguous", NULL, fits=(BOTH, WITHOUT_LOSS)), None, [BOTH, WITHOUT_LOSS]),
        (Verdict("unknown", NULL, unproved=("body",)), None, [BOTH, WITHOUT_BODY]),
        (UNKNOWN, partial(), [NULL, LAG.fit, FILM.fit]),
        (UNKNOWN, partial(LAG, FILM), [NULL, LAG.fit, DRIFT.fit]),
        *((Verdict(kind, NULL), None, None) for kind in ("named", "none", "not_identifiable", "unknown")),
        # logs in doubt are to be corrected first
        (Verdict("unknown", NULL, unproved=("body",), suspected=("late",)), None, None),
    ],
)
def test_a_test_is_to_separate_all_answers_that_are_left(
    verdict: Verdict, of_unknown: Partial | None, asked: list[Fit] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an unknown, what explains most stands against none of it and the next best of another family."""
    monkeypatch.setattr(deciding, "propose", lambda _problem, answers, _pool: list(answers))
    less = [("loss", WITHOUT_LOSS), ("body", WITHOUT_BODY)]
    found: Any = decisive_test(FOUND, verdict, less, of_unknown)
    assert found == (None if asked is None else [fit.config for fit in asked])
