"""What a destination lacks: outages, and messages that others of their key have overtaken."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from observer.bus.backlog import STEP_KEYS, Backlog, MissingSpan


def after(time_s: float) -> float:
    return math.nextafter(time_s, math.inf)


@pytest.fixture
def backlog(tmp_path: Path) -> Backlog:
    """One that has got the values up to 10 s."""
    made = Backlog(tmp_path / "sent", "a broker")
    made.resumed(1.0)
    assert made.first is None, "what came before the first value of all is not missing"
    made.got(10.0)
    return made


def all_of(backlog: Backlog) -> list[MissingSpan]:
    """The spans one after the other, as they are sent."""
    found = []
    while (span := backlog.first) is not None:
        found.append(span)
        backlog.sent(span, span.to_s)
    return found


def test_what_is_behind_counts_an_outage_that_still_lasts(backlog):
    assert backlog.behind_s(10.0) == backlog.left_s == 0.0
    assert backlog.behind_s(25.0) == pytest.approx(15.0)
    backlog.resumed(30.0)
    assert backlog.left_s == pytest.approx(20.0)
    backlog.sent(backlog.first, 22.0)
    assert backlog.behind_s(5.0) == pytest.approx(8.0)


def test_an_outage_is_missing_from_the_last_value_that_arrived_to_the_first_after_it(backlog, tmp_path):
    backlog.resumed(50.0)
    assert backlog.first == MissingSpan(after(10.0), 50.0, STEP_KEYS)
    backlog.sent(backlog.first, 30.0)
    backlog.save()
    kept = Backlog(tmp_path / "sent", "a broker")
    assert kept.first == MissingSpan(30.0, 50.0, STEP_KEYS)
    assert Backlog(tmp_path / "sent", "another broker").first is None


def test_what_was_overtaken_is_missing_of_its_key_alone(backlog):
    backlog.overtaken("heat", 20.0, 22.0)
    backlog.overtaken("estimate", 20.0, 23.0)
    heat, estimate = all_of(backlog)
    assert heat == MissingSpan(after(20.0), 22.0, ("heat",))
    assert estimate == MissingSpan(after(20.0), 23.0, ("estimate",))


def test_an_outage_takes_what_was_overtaken_within_it(backlog):
    backlog.overtaken("heat", 8.0, 12.0)
    backlog.overtaken("heat", 14.0, 16.0)
    backlog.resumed(50.0)
    before, outage = all_of(backlog)
    assert before == MissingSpan(after(8.0), after(10.0), ("heat",))
    assert outage == MissingSpan(after(10.0), 50.0, STEP_KEYS)


def test_sending_one_span_leaves_the_others_whole(backlog):
    backlog.overtaken("heat", 20.0, 22.0)
    backlog.overtaken("readings", 20.0, 22.0)
    first = backlog.first
    backlog.sent(first, 21.0)
    assert backlog.first == MissingSpan(21.0, 22.0, ("heat",))
    backlog.sent(first, 22.0)
    assert backlog.first == MissingSpan(after(20.0), 22.0, ("readings",))
