"""A typical user's log whose heat comes three minutes late against its law: taken for bodies, to the end."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from observer.align.aligner import AlignPlan, frames_of_log
from observer.discovery.discover import discover
from observer.files.logs import Log
from observer.installation import parse
from tests.truth.machine.generate import Case, runs_of
from tests.truth.machine.logs import configuration
from tests.truth.machine.troubles import _moved

LATE_S = 180.0


@pytest.mark.slow
@pytest.mark.nightly
def test_a_search_tries_a_plain_body_at_an_end_beside_one_that_takes_of_the_nuts_heat() -> None:
    """It ended in `KeyError: 'heat_share'`."""
    case = Case("late2", (), 3, typical=True, logs=1)
    run = _moved(runs_of(case)[0], -LATE_S)
    config = parse(tomllib.loads(configuration(case.unmodelled)))
    log = Log(Path("log.csv"), run.time_s, run.channels, run.values)
    found = discover(config, [list(frames_of_log(log, AlignPlan.of(config)))])
    assert [s.what for s in found.suspects] == ["heat starts late"]
    assert "attached_mass at nut" in [t.candidate.name for t in found.search.chosen]
