"""A wrong configuration is answered in words or accepted: no traceback, and no long wait."""

from __future__ import annotations

from functools import cache

import pytest

from observer.errors import ConfigError
from observer.installation.examine import examine
from observer.report.check import doubts, findings
from tests.hostile.mutants import Mutant, mutants, tables, verdict
from tests.system.bad_inputs import changed
from tests.system.plant import write

SAMPLE = 40
POINT = [{"name": "end", "shape": "point", "position_m": 0.0}]


@pytest.mark.parametrize("name", sorted(tables()))
def test_the_configuration_that_is_mutated_is_good(name, tmp_path):
    sentences = doubts(examine(write(tmp_path, tables()[name])))
    assert not [w for w in sentences if "usual" in w or "both" in w or "finer" in w]


@cache
def sample() -> list[Mutant]:
    return list(mutants(SAMPLE, seed=20))


@pytest.mark.parametrize("number", range(SAMPLE))
def test_a_mutated_configuration_is_accepted_or_rejected_in_words(number, tmp_path):
    verdict(sample()[number], tmp_path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"model__settle_s": 1e-4}, "model.settle_s.*asks for 400 modes.*give at least"),
        ({"model__truncation": 0.99999999, "source": POINT}, "model.truncation.*modes.*give 0.9995"),
        ({"model__modes": 400}, "model.modes.*at most"),
    ],
)
def test_endless_work_is_rejected_with_a_remedy(changes, words, tmp_path):
    """It is modes that are counted here, not seconds; each of these ran for minutes."""
    with pytest.raises(ConfigError, match=words) as caught:
        findings(examine(write(tmp_path, changed(**changes))))
    if "settle_s" in words:
        seconds = float(str(caught.value).split("give at least ")[1].split(" s")[0])
        assert findings(examine(write(tmp_path, changed(model__settle_s=seconds))))["modes"] <= 150
