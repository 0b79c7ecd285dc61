"""A wrong configuration is answered in words or accepted: no traceback, and no long wait."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

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
def test_the_mutated_configuration_is_good(name, tmp_path):
    found = doubts(examine(write(tmp_path, tables()[name])))
    assert not [w for w in found if "usual" in w or "both" in w or "finer" in w]


@cache
def sample() -> list[Mutant]:
    return list(mutants(SAMPLE, seed=20))


@pytest.mark.parametrize("number", range(SAMPLE))
def test_a_mutant_is_answered(number, tmp_path):
    verdict(sample()[number], tmp_path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"model__settle_s": 1e-4}, ("model.settle_s", "asks for 400 modes", "give at least")),
        ({"model__truncation": 0.99999999, "source": POINT}, ("model.truncation", "modes", "give 0.9995")),
        ({"model__modes": 400}, ("model.modes", "at most")),
    ],
)
def test_endless_work_is_rejected_with_a_remedy(changes, words, tmp_path):
    """It is modes that are counted here, not seconds; each of these ran for minutes."""
    with pytest.raises(ConfigError) as caught:
        findings(examine(write(tmp_path, changed(**changes))))
    for word in words:
        assert word in str(caught.value)


def test_the_remedy_is_one(tmp_path):
    with pytest.raises(ConfigError) as caught:
        findings(examine(write(tmp_path, changed(model__settle_s=1e-4))))
    seconds = float(str(caught.value).split("give at least ")[1].split(" s")[0])
    assert findings(examine(write(tmp_path, changed(model__settle_s=seconds))))["modes"] <= 150


def _pipe(path: Path) -> Path:
    os.mkfifo(path / "pipe")
    return path / "pipe"


@pytest.mark.parametrize(
    "made",
    [_pipe, lambda _: Path("/dev/zero"), lambda folder: folder, lambda folder: folder / ("x" * 300)],
    ids=["a pipe nobody writes to", "a device without end", "a folder", "a name that no file can have"],
)
def test_a_path_that_is_not_a_file_is_neither_waited_for_nor_read(made, tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        examine(made(tmp_path))


def test_a_file_without_end_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(50_000_000_000)
    with pytest.raises(ConfigError, match="larger than 4 MB"):
        examine(path)
