"""The page of alarms has the program's own table."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from observer.quality.alarm_classes import ALARM_CLASSES
from observer.tables.publishing import AlarmKind

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "alarms.md"


def test_the_page_says_of_each_kind_what_the_program_does():
    page = PAGE.read_text(encoding="utf-8")
    for name, kind in ALARM_CLASSES.items():
        latched = "yes" if kind.latched else "no"
        row = f"| `{name}` | {kind.severity} | {kind.on_s:g} | {kind.off_s:g} | {latched} |"
        assert row in page


def test_every_class_of_alarms_can_be_switched_off():
    assert set(get_args(AlarmKind)) == set(ALARM_CLASSES)
