"""Pages say which program a campaign measured, and whether its code has changed since."""

from __future__ import annotations

import json
from datetime import UTC, date, datetime
from pathlib import Path

import pytest

from campaigns import runs

DOCS = runs.ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if runs.MARK.search(page.read_text(encoding="utf-8")))
NO_CAMPAIGN = {"docs/benchmarks/history.csv", "docs/mutants/survivors.csv"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_has_the_present_sentence_about_each_run(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert runs.with_captions(text) == text, "make evidence writes it"


def test_every_table_of_results_is_dated_on_a_page() -> None:
    tables = {path.relative_to(runs.ROOT).as_posix() for path in DOCS.glob("*/*.csv")} - NO_CAMPAIGN
    marked = {mark[2] for page in PAGES for mark in runs.MARK.finditer(page.read_text(encoding="utf-8"))}
    assert marked == tables == set(runs.entries())


def test_a_banner_names_the_code_that_has_changed() -> None:
    entry = {"date": "2026-11-29", "version": "0.1.0", "commit": "0123abcd"}
    same, other = runs.digest("campaigns"), "0" * 12
    run = "Run on 2026-11-29 with version 0.1.0, commit `0123abcd`."
    assert runs.caption(entry | {"code": {"campaigns": same}}) == run
    banner = f"{run} **Its code has changed since** (`campaigns`, `observer/model`)."
    assert runs.caption(entry | {"code": {"campaigns": same, "observer/model": other}}) == banner


def test_a_campaign_that_begins_is_dated(tmp_path: Path) -> None:
    file, table = tmp_path / "runs.json", DOCS / "gap" / "results.csv"
    name = table.relative_to(runs.ROOT).as_posix()
    old = {"date": "2000-01-01", "version": "0", "commit": "0", "code": {"campaigns": "0"}}
    file.write_text(json.dumps({name: old}), encoding="utf-8")
    runs.note_run(tmp_path / "results.csv", file)
    assert runs.entries(file) == {name: old}
    runs.note_run(table, file)
    entry = runs.entries(file)[name]
    assert abs((datetime.now(UTC).date() - date.fromisoformat(entry["date"])).days) <= 1
    assert entry["code"] == {"campaigns": runs.digest("campaigns")}
    assert "changed" not in runs.caption(entry)
