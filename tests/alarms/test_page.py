"""The page of alarms has the program's own table."""

from __future__ import annotations

from campaigns.alarms.trial import PAGE
from observer.alarms.states import KINDS


def test_the_page_says_of_each_kind_what_the_program_does():
    page = PAGE.read_text(encoding="utf-8")
    for name, kind in KINDS.items():
        latched = "yes" if kind.latched else "no"
        row = f"| `{name}` | {kind.severity} | {kind.on_s:g} | {kind.off_s:g} | {latched} | {kind.remedy} |"
        assert row in page
