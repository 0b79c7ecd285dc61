from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.config.machine import Config
from observer.discovery.discover import Discovery, discover
from observer.discovery.localise import Event
from observer.discovery.result import discovery_result
from observer.discovery.verdict import partial_of
from observer.discovery.worth import Worth
from observer.fit.evidence import PROOF, UNUSED
from observer.frames import FrameBlock
from observer.library.searching import configurations
from observer.report.advice import next_step
from observer.report.discovery import write_discovery_report
from observer.report.panels import scale_limit
from observer.report.panels_discovery import coloured, shortened, tracks_of
from observer.report.wording import headline, kelvin, partial_sentence
from tests.logs.machines import machine
from tests.logs.simulated import made_log
from tests.report.verdicts import BASE, SURFACE, candidate

HOSTILE = '<b>"$x_1$ & -->'
VOID = {"meta", "br", "link", "img", "hr", "input"}


class Page(HTMLParser):
    """What a page says, and whether its tags match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.said: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []
        self.text = " ".join(" ".join(self.said).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attrs:
            if key == "id":
                self.ids.append(str(value))
            if key in ("src", "href", "xlink:href", "data", "srcset", "action"):
                self.links.append(str(value))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.said.append(data)


def _case() -> tuple[Config, list[list[FrameBlock]]]:
    """A bar whose sensor `b` reads 0.8 K too much, which its model does not know; one log with a gap."""
    lacking = machine(calibrate={"free": ["surface.convection_W_m2K"]})
    truth = machine(effect=[{"kind": "sensor_bias", "target": "b", "offset_K": 0.8}])
    log = made_log(truth, 1, minutes=90.0)
    gap = (log.time_s > 1200.0) & (log.time_s < 1500.0)
    values, fresh = log.values.copy(), log.fresh.copy()
    column = lacking.channels.index("a_degC")
    values[gap, column], fresh[gap, column] = np.nan, False
    return lacking, [[replace(log, values=values, fresh=fresh)]]


@pytest.fixture(scope="module")
def found() -> Discovery:
    """A real search; its verdict is set, for the page must say whatever the verdict is."""
    whole = discover(*_case())
    verdict = replace(whole.verdict, kind="named", fit=whole.search.fit)
    return replace(whole, verdict=verdict, event=None, experiment=None)


def _renamed(found: Discovery) -> tuple[Discovery, dict[str, Any]]:
    """The same, with a sensor's name that no configuration would let through."""
    a, b, c = found.problem.config.sensor
    sensors = (a, b.model_copy(update={"name": HOSTILE}), c)
    problem = replace(found.problem, config=found.problem.config.model_copy(update={"sensor": sensors}))

    def named(value: Any) -> Any:
        if isinstance(value, dict):
            return {named(key): named(each) for key, each in value.items()}
        if isinstance(value, list):
            return [named(each) for each in value]
        return HOSTILE if value == "b" else value

    return replace(found, problem=problem), named(discovery_result(found))


def _page(found: Discovery, folder: Path, result: dict[str, Any] | None = None) -> tuple[str, Page]:
    path = folder / "report.html"
    write_discovery_report(path, found, result or discovery_result(found), ["run <a>.csv"])
    text = path.read_text(encoding="utf-8")
    return text, Page(text)


def test_a_page_is_whole_and_needs_nothing_from_elsewhere(found: Discovery, tmp_path: Path) -> None:
    text, page = _page(found, tmp_path)
    assert "://" not in text
    assert "@import" not in text
    assert all(link.startswith(("#", "data:image/png")) for link in page.links)
    assert not {"script", "link", "iframe", "object", "img"} & set(page.tags)
    assert len(page.ids) == len(set(page.ids))
    for reference in re.findall(r'url\(#([^)]+)\)|href="#([^"]+)"', text):
        assert "".join(reference) in page.ids
    assert len(text) < 1_500_000
    assert "prefers-color-scheme: dark" in text
    assert "@media print" in text


def test_a_page_names_what_was_found_where_and_in_which_log(found: Discovery, tmp_path: Path) -> None:
    result = discovery_result(found)
    assert [e["kind"] for e in result["effects"]] == ["sensor_bias"]
    _, page = _page(found, tmp_path)
    assert page.tags.count("h1") == 1
    for effect in result["effects"] + result["ranking"]:
        assert effect["kind"] in page.text
    for word in (
        "a, °C:",
        "b, °C:",
        "c, °C:",
        "sensor_bias at b",
        "run <a>.csv",
        "surface.convection_W_m2K",
        "proof",
        "fitted",
        "left out",
    ):
        assert word in page.text
    title = page.text[: page.text.index(" – ")]
    assert title == headline(found.verdict, result)


def test_names_cannot_become_tags(found: Discovery, tmp_path: Path) -> None:
    renamed, result = _renamed(found)
    text, page = _page(renamed, tmp_path, result)
    assert "<b>" not in text
    assert "run <a>" not in text
    assert "b" not in page.tags
    assert f"{HOSTILE}, °C:" in page.text  # as it was written, its dollars no formula
    assert f"The model lacks a constant error of sensor {HOSTILE}" in page.text


def test_the_drawings_follow_the_colours_of_the_page(found: Discovery, tmp_path: Path) -> None:
    text, _ = _page(found, tmp_path)
    drawn = "".join(re.findall(r"<svg.*?</svg>", text, re.DOTALL))
    assert "currentColor" in drawn
    fixed = set(re.findall(r"(?:fill|stroke): (#[0-9a-f]{6})", drawn))
    assert fixed == set()
    for name in set(re.findall(r"var\((--\w+)\)", drawn)):
        assert text.count(f"{name}: #") == 2  # one for light, one for dark


def test_an_event_is_framed_and_described(found: Discovery, tmp_path: Path) -> None:
    event = Event("b", "heat_up", 0, 600.0, 1800.0, -3.0, 0.6, -0.7)
    verdict = replace(found.verdict, kind="unknown", remains="on data held back")
    text, page = _page(replace(found, verdict=verdict, event=event), tmp_path)
    plain, _ = _page(found, tmp_path)
    assert "3 ± 1 W less heat than the model has, measured 0.70 K below predicted" in page.text
    assert (
        text.count("stroke: currentColor") == plain.count("stroke: currentColor") + 4
    )  # one a map, each in two widths


def test_the_gap_beyond_tolerances_is_beside_the_raw_one(found: Discovery, tmp_path: Path) -> None:
    result = discovery_result(found)
    whole, sensors = result["gap"]["beyond_tolerances"], result["gap"]["per_sensor"]
    assert whole["after_rms_K"] < 0.5 * whole["before_rms_K"]
    _, page = _page(found, tmp_path)
    assert "beyond tolerances" in page.text
    for gap in (whole, *(each["beyond_tolerances"] for each in sensors.values())):
        assert f"{kelvin(gap['before_rms_K'])} → {kelvin(gap['after_rms_K'])}" in page.text


def test_a_family_and_a_partial_answer_are_on_the_page(found: Discovery, tmp_path: Path) -> None:
    said = {"sets": ((candidate("surface_convection"),), (candidate("radiation"),)), "fits": ()}
    doubt = replace(found, verdict=replace(found.verdict, kind="ambiguous", **said))
    result = discovery_result(doubt) | {"family": SURFACE}
    assert "4.53 (4.12 … 4.94) W/m²K" in _page(doubt, tmp_path, result)[1].text.partition("</h1>")[0]
    verdict = replace(found.verdict, kind="unknown", remains="on data held back")
    unknown = replace(found, verdict=verdict, partial=partial_of(found.search))
    result = discovery_result(unknown)
    assert result["partial"]["kind"] == "sensor_bias"
    assert result["partial"]["family"] is None
    assert result["partial"]["remains_beyond_tolerances_rms_K"] <= result["partial"]["remains_rms_K"]
    page = _page(unknown, tmp_path, result)[1]
    assert f"{partial_sentence(result['partial'])}." in page.text


def test_what_explains_most_of_an_unknown_is_offered_as_acandidate(found: Discovery, tmp_path: Path) -> None:
    verdict = replace(found.verdict, kind="unknown", remains="on data held back")
    unknown = replace(found, verdict=verdict, partial=partial_of(found.search))
    result = discovery_result(unknown) | {"logs": ["one.csv"]}
    partial = result["partial"]
    assert partial["candidate"] == "candidate.toml"
    assert partial["log"] == 1
    assert partial["proof"]["after_rms_K"] < 0.2 * partial["proof"]["before_rms_K"]
    texts = configurations("[surface]\nconvection_W_m2K = 1.0\n", unknown, result)
    assert list(texts) == ["candidate.toml"]
    text = texts["candidate.toml"]
    assert text.startswith("# A candidate, not a result: sensor_bias at b explains ")
    assert f"to {kelvin(partial['proof']['after_rms_K'])} rms" in text.replace("\n# ", " ")
    (effect,) = tomllib.loads(text)["effect"]
    assert (effect["kind"], effect["target"]) == ("sensor_bias", "b")
    step = next_step(result, "one.csv", "machine.toml", "out")
    assert step["text"].startswith(f"Look at {partial['most_on']} in one.csv")
    assert step["command"] == "observer adopt out --config machine.toml --candidate"
    assert partial["explains_most"]


def test_a_candidate_that_explains_less_than_half_is_marked_and_not_recommended(found: Discovery) -> None:
    verdict = replace(found.verdict, kind="unknown", remains="on data held back")
    partial = partial_of(found.search)
    assert partial is not None
    weak = replace(found, verdict=verdict, partial=replace(partial, proof_K=(1.0, 0.8)))
    result = discovery_result(weak) | {"logs": ["one.csv"]}
    assert result["partial"]["candidate"] == "candidate.toml"
    assert not result["partial"]["explains_most"]
    (text,) = configurations("[surface]\nconvection_W_m2K = 1.0\n", weak, result).values()
    comment = text.replace("\n# ", " ")
    assert comment.startswith("# A weak candidate, under half explained where fitted or on data held back: ")
    assert "from 1.00 K to 0.80 K" in comment
    step = next_step(result, "one.csv", "machine.toml", "out")
    assert "--candidate" not in (step["command"] or "")


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({"verdict": "named", "effects": [1]}, "observer adopt out --config c.toml"),
        ({"suspects": [1]}, "observer discover a.csv b.csv --config c.toml --output out"),
        (
            {"verdict": "ambiguous", "experiment": {}},
            "observer discover NEW a.csv b.csv --config c.toml --output out",
        ),
        ({"verdict": "none"}, "observer calibrate a.csv b.csv --config c.toml --output out"),
        ({"verdict": "not_identifiable"}, None),
    ],
)
def test_what_to_do_next_is_a_command(changes: dict[str, Any], command: str | None) -> None:
    assert next_step(BASE | changes, "a.csv b.csv", "c.toml", "out")["command"] == command


def test_a_page_says_what_it_is_worth_when_and_of_what_it_was_made(found: Discovery, tmp_path: Path) -> None:
    worth = Worth(15.3, 0.726, 23.5, 112.4, 0.8, 0.2)
    result = discovery_result(replace(found, worth=worth)) | {
        "date": "2026-11-25T23:01:02+00:00",
        "version": "9.9",
    }
    result |= {
        "config_sha256": "0abc",
        "logs": ["run <a>.csv"],
        "next": {"text": "Do", "command": "observer & co"},
    }
    _, page = _page(found, tmp_path, result)
    assert result["worth"]["after_rms_um"] == 0.726
    for words in (
        "15.3 µm → 0.73 µm",
        "off by 15.3 µm rms (at most 23.5 µm) and is now off by 0.73 µm (112 µm)",
    ):
        assert words in page.text
    for words in ("2026-11-25T23:01:02+00:00", "9.9", "0abc", "observer & co"):
        assert words in page.text


def test_missing_data_of_a_log_stay_a_gap(found: Discovery) -> None:
    evidence = found.problem.evidence
    (track,) = tracks_of(evidence, ["one"], {"measured": evidence.measured_degC})
    a, b = track.values["measured"][:2]
    inside = (track.time_s > 1230.0) & (track.time_s < 1500.0)
    assert np.isnan(a[inside]).all()
    assert np.isfinite(a[~inside]).mean() > 0.97
    assert np.isfinite(b).all()
    assert set(track.role) == {0, 1, UNUSED, PROOF}
    assert (np.diff(np.flatnonzero(track.role == PROOF)) == 1).all()


def test_zero_has_no_colour_and_signs_have_their_own() -> None:
    cold, zero, nothing, warm = coloured(np.array([[-2.0, 0.0, np.nan, 9.0]]), 2.0)[0]
    assert cold[3] == warm[3] == 1.0
    assert zero[3] == nothing[3] == 0.0
    assert cold[2] > cold[0]  # blue
    assert warm[0] > warm[2]  # vermilion


def test_a_scale_is_round_and_holds_what_it_shows() -> None:
    assert scale_limit([np.array([0.1, -1.83, np.nan])], 0.25) == 2.0
    assert scale_limit([np.array([0.001])], 0.25) == pytest.approx(0.3)
    assert scale_limit([np.array([np.nan])], 0.25) == pytest.approx(0.3)
    assert shortened("a_name_that_is_long", 9) == "a_na…long"
    assert shortened("short", 9) == "short"
