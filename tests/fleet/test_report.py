"""The table and the page of a fleet."""

import json
import re

import pyarrow.parquet as pq

from observer.fleet.report import flattened, page, write_table


def _row(machine, verb, name, **found):
    return {
        "machine": machine, "verb": verb, "name": name, "logs": [f"/logs/{machine}/{name}.csv"],
        "config": "/c.toml", "folder": f"{machine}/{verb}/{name}", "problem": None, "seconds": 1.0,
        "found": {"type": "1 m × 36 mm", "sources": ["left"], **found},
    }  # fmt: skip


def _replays():
    heat_W = {f"m{i}": 9.0 + 0.1 * i for i in range(5)} | {"m9<b>": 15.0}
    return [
        _row(m, "replay", "run", heat_mean_W={"left": w}, speed_mean_rpm={"left": 1500.0}, rows=9, good=1.0)
        for m, w in heat_W.items()
    ]


def _discoveries():
    gap = {"before_rms_K": 2.3, "after_rms_K": 0.07}
    named = [{"kind": "attached_mass", "target": "left", "parameters": {}}]
    calibrated = {"surface.convection_W_m2K": {"value": 15.2, "ci95": [14.9, 15.5], "unit": "W/m2K"}}
    rest = {"alternatives": [], "calibrated": calibrated, "gap": gap}
    return [
        _row("m0", "discover", "discover", verdict="named", effects=named, **rest),
        _row("m1", "discover", "discover", verdict="none", effects=[], **rest),
        _row("m2", "discover", "discover", verdict="unknown", effects=[], **rest),
    ]


def _text(html: str) -> str:
    body = re.sub(r"</?span[^>]*>", "", html.split("<body>")[1])
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body))


def test_the_page_names_missing_effects_and_hot_machines():
    broken = _row("m4", "replay", "bad") | {"problem": "bad.csv: <no> such file"}
    html = page([*_replays(), *_discoveries()], [broken])
    said = _text(html)
    assert "attached_mass (left) 1 m0" in said
    assert "something the library does not have 1 m2" in said
    assert "m9&lt;b&gt; left 1500 15.0 9.2 1.63 5 100" in said
    assert said.index("m2 2.3 → 0.07") < said.index("nothing 1 m1"), "what is to be seen to comes first"
    assert "bad.csv: &lt;no&gt; such file" in said
    assert "<b>" not in html.replace("<b>left 15.0 W", ""), "names of machines are text"


def test_machines_are_counted_as_people_count_and_on_a_phone_each_cell_has_its_head():
    rows = [
        row | {"machine": f"lathe-{i}", "folder": f"lathe-{i}/discover"}
        for i in (10, 2, 1)
        for row in _discoveries()[1:2]
    ]
    html = page(rows, [])
    assert _text(html).count("lathe-1, lathe-2, lathe-10") == 1, "who lacks nothing"
    assert '<td data-head="lacks">nothing</td>' in html


def test_doubts_about_a_log_that_was_used_are_reported_once():
    doubted = [_row("m2", verb, "run", doubts=["run.csv: looks like °F"]) for verb in ("replay", "identify")]
    for row in doubted:
        row["found"] |= {"heat_mean_W": {}, "speed_mean_rpm": {}}
    assert _text(page(doubted, [])).count("m2 run.csv: looks like °F") == 1


def test_the_page_asks_for_nothing_from_elsewhere():
    html = page([*_replays(), *_discoveries()], [])
    assert not re.search(r"https?:|<script|<link|<img|@import|url\(", html)


def test_a_page_of_failures_alone_lists_what_could_not_be_done():
    assert "Could not be done" in page([], [_row("m", "replay", "bad") | {"problem": "gone", "found": {}}])


def test_heats_by_identify_stand_before_a_replay_of_the_same_log():
    rows = _replays()
    better = _row("m0", "identify", "run", heat_mean_W={"left": 9.4}, speed_mean_rpm={"left": 1500.0})
    assert "left 9.4 W" in page([*rows, better], [])


def test_a_heat_has_its_share_of_good_estimates_and_is_grey_where_that_is_small():
    rows = _replays()
    rows[1]["found"]["good"], rows[-1]["found"]["good"] = 0.49, 0.051
    better = _row("m1", "identify", "run", heat_mean_W={"left": 9.4}, speed_mean_rpm={"left": 1500.0})
    html = page([*rows, better], [])
    assert "left 9.0 W (usual 9.4 W), 100 % good" in _text(html).replace("\N{NO-BREAK SPACE}", " ")
    assert '<span class="doubtful">left 9.4 W (usual 9.3 W), 49\N{NO-BREAK SPACE}% good</span>' in html
    assert (
        '<span class="doubtful"><b>left 15.0 W (usual 9.3 W), hot</b>, 5\N{NO-BREAK SPACE}% good</span>'
        in html
    )
    assert '<span class="doubtful">15.0</span>' in html
    assert ".doubtful {" in html


def test_a_heat_of_which_no_replay_says_how_good_it_was_says_nothing_of_it():
    row = _row("m0", "identify", "run", heat_mean_W={"left": 9.4}, speed_mean_rpm={"left": 1500.0})
    html = page([row], [])
    assert "left 9.4 W (no like to compare)" in _text(html)
    assert '"doubtful"' not in html


def test_the_table_has_a_column_for_each_number(tmp_path):
    rows = [*_replays(), *_discoveries(), _row("m", "replay", "x") | {"problem": "gone", "found": {}}]
    write_table(tmp_path / "results.parquet", rows)
    read = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert [row["machine"] for row in read] == [row["machine"] for row in rows]
    assert read[0]["heat_mean_left_W"] == 9.0
    assert read[6]["surface.convection_W_m2K_low"] == 14.9
    assert json.loads(read[6]["effects"])[0]["kind"] == "attached_mass"
    assert read[-1]["problem"] == "gone"
    assert read[-1]["heat_mean_left_W"] is None
    assert not list(tmp_path.glob(".*"))


def test_an_interval_without_an_end_is_an_empty_cell():
    row = _row("m", "calibrate", "c", calibrated={"k": {"value": 1.0, "ci95": [0.5, float("inf")]}})
    assert flattened(row)["k_high"] is None
