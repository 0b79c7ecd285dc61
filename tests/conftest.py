"""What holds for all tests: their order, which of them stay together, and hypothesis without time limits."""

from __future__ import annotations

import gc
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parents[1]
# Tests of the whole program last seconds, most others a fraction of one.
LONG = "tests/system/"

# A busy computer must not fail a test. What else is set, as by hypothesis itself in CI, stays.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what lasts longest, the others in their random order: all workers then end together."""

    def rank(item: pytest.Item) -> tuple[bool, ...]:
        file = item.location[0]
        return item.get_closest_marker("slow") is None, not _shares(file), not file.startswith(LONG)

    items.sort(key=rank)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Have `--dist loadscope` give each test to whoever is free, but keep together what shares something."""
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return file if _shares(file) else nodeid

    return Together(config, log) if config.getvalue("dist") == "loadscope" else None


def pytest_collection_finish() -> None:
    """Keep all that was imported out of later garbage collections, each of which would go through it."""
    gc.collect()
    gc.freeze()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files without any test of those marks that are asked for: to import all takes as long as many
    tests, in each worker.
    """
    if not collection_path.name.startswith("test_"):
        return None
    text, asked = _text(collection_path), config.option.markexpr
    if asked.startswith("system"):
        return ("mark.system" not in text and "pytestmark" not in text) or None
    return (asked.startswith("not system") and "\npytestmark = pytest.mark.system" in text) or None


def _shares(file: str) -> bool:
    """Whether tests of a file share what is made once for it: a machine, a browser, a demo."""
    return 'scope="module"' in _text(ROOT / file)


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
