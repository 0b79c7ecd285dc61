"""What docs/papers.md names is there: its paths, its names in the files it gives, and its tests."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8")
PATH = r"(?:observer|tests|config|docs|drivers|campaigns)/[\w./-]+\.(?:py|toml|md)"


def test_its_paths_exist() -> None:
    paths = set(re.findall(rf"`({PATH})`", PAGE))
    assert len(paths) > 20
    assert not [path for path in sorted(paths) if not (ROOT / path).exists()]


def test_its_names_are_in_the_files_that_it_gives() -> None:
    lists = re.findall(rf"((?:`\w+`(?:, | and )?)+) (?:in|of) `({PATH})`", PAGE)
    named = [(name, path) for names, path in lists for name in re.findall(r"`(\w+)`", names)]
    assert len(named) > 30
    lost = [
        (name, path)
        for name, path in named
        if not re.search(rf"\b{name}\b", (ROOT / path).read_text(encoding="utf-8"))
    ]
    assert not lost


def test_its_other_names_are_somewhere_in_the_code() -> None:
    """In that of the program, of its tests, and of the scripts of its figures."""
    folders = [ROOT / name for name in ("observer", "tests", "docs/figures")]
    files = {path for folder in folders for path in folder.rglob("*.py")} - {Path(__file__)}
    words = {word for path in files for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    assert not set(re.findall(r"`([A-Za-z_]\w*)`", PAGE)) - words


def test_its_tests_are_tests() -> None:
    named = re.findall(rf"`(test_\w+)` in `({PATH})`", PAGE)
    assert len(named) > 10
    assert len(named) == len(re.findall(r"`test_\w+`", PAGE))
    lost = [
        (name, path)
        for name, path in named
        if f"def {name}(" not in (ROOT / path).read_text(encoding="utf-8")
    ]
    assert not lost
