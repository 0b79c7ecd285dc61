"""What one does with the page in a real browser: acknowledge, read, zoom, save."""

from __future__ import annotations

import csv
import io
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tests.page.browser import IN_A_BROWSER, complaints
from tests.page.served import DOCUMENTS, HEAD, NOW_S, PLACES_M, served_page
from tests.patience import PATIENCE_S
from tests.record.made import write_steps

pytestmark = IN_A_BROWSER

MACHINE = 'lathe\'s-"7"<b>'
ROWS, STEP_S = 300, 10.0
POINTS = 100_000
GOOD = {
    **HEAD,
    "channels": {
        "t3_degC": {"value": 36.0, "quality": "good", "age_s": 0.0},
        "nut_position_m": {"value": 0.4, "quality": "good", "age_s": 0.0},
    },
}
ERROR = {**DOCUMENTS["error"], "error_um": [0.0, 20.0, -41.0], "bound_um": [5.0, 5.0, 9.0]}


def _row(k: int) -> dict:
    time_s = NOW_S - (ROWS - k) * STEP_S
    return {
        "time_s": time_s, "quality": "good", "temperature_degC": [25.0 + k / 100, 26.0, 27.0],
        "sigma_K": [0.1] * 3, "bound_K": [0.5] * 3, "error_um": [0.0, 20.0, 41.0], "sigma_um": [1.0] * 3,
        "bound_um": [5.0] * 3, "heat_W": {"nut": 10.0 + k}, "sigma_W": {"nut": 0.5}, "bound_W": {"nut": 3.0},
        "law_W": {}, "channels": {"nut_position_m": 0.4}, "crossed": {}, "lost": [],
    }  # fmt: skip


PAST = [_row(k) for k in range(ROWS)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A past of 100,000 steps."""
    path = tmp_path_factory.mktemp("recordings")
    time_s = NOW_S - 2.0 * POINTS + 2.0 * np.arange(POINTS)
    write_steps(path, f"{MACHINE}-z", time_s, t3_degC=20.0 + np.arange(POINTS) % 100, nut_position_m=0.5)
    return path


@pytest.fixture(scope="module")
def served(folder):
    """A machine of a hostile name with an hour behind it; its address and the bus."""
    with served_page(documents={**DOCUMENTS, "error": ERROR}, recordings=folder, machine=MACHINE) as given:
        yield given


@pytest.fixture
def opened(browser, served):
    """Open the page at a hash, with an hour behind it; nothing may complain."""
    url, feed = served
    problems = []
    context = browser.new_context(
        viewport={"width": 1280, "height": 800}, accept_downloads=True, has_touch=True
    )
    context.grant_permissions(["clipboard-read", "clipboard-write"])

    def at(words: str = ""):
        page = context.new_page()
        problems.append(complaints(page))
        page.route("**/recent.json", lambda r: r.fulfill(json={**r.fetch().json(), "rows": PAST}))
        page.goto(f"{url}{words}" if words.startswith("#") or not words else words)
        page.wait_for_selector("tr[data-sensor=t3]")
        page.wait_for_selector("#c-heats canvas")
        page.wait_for_timeout(200)  # of what comes faster than ten times a second the page leaves some out
        feed.document("readings", GOOD)
        reading = "() => document.querySelector('[data-field=reading]')?.textContent === '36.00 °C'"
        page.wait_for_function(reading)
        return page

    with closing(context):
        yield at
        assert not any(problems)


def _saved(page, panel: str, kind: str) -> bytes:
    with page.expect_download() as saved:
        page.click(f"#{panel} .tools button:text-is('{kind}')")
    assert '"' not in saved.value.suggested_filename
    return Path(saved.value.path()).read_bytes()


def _table(data: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(data.decode())))


def _words(page, place: str) -> str:
    return " ".join(page.inner_text(place).split())


def _over(page, chart: str, share: float) -> None:
    """Point at a place of a chart, a share of its width from the left."""
    page.locator(chart).scroll_into_view_if_needed()
    box = page.locator(f"{chart} .u-over").bounding_box()
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def test_the_first_look_says_verdict_alarm_and_errors_with_their_bounds(opened):
    page = opened()
    assert page.inner_text("#state") == "Degraded"
    # at 400 mm between 0 µm and 20 µm at 500 mm; the 41 µm at 1000 mm are beyond the stroke
    page.wait_for_function("() => document.getElementById('f-here').innerText.startsWith('16.0 µm')")
    assert _words(page, "#f-here") == "16.0 µm ± 1.0, bound 5.0 µm"
    assert _words(page, "#f-error") == "20.0 µm at 500 mm, ± 1.0, bound 5.0 µm"
    assert page.inner_text("#f-error-name") == "largest error within the stroke"
    assert "fix the cable" in page.inner_text("#hero-alarm")


def test_an_acknowledged_alarm_is_quiet_and_one_that_comes_back_is_new(opened, served):
    _, feed = served
    page = opened()
    (alarm,) = DOCUMENTS["alarms"]["alarms"]
    try:
        page.click("#hero-alarm button")
        acknowledged = feed.acknowledged.get(timeout=PATIENCE_S)
        assert acknowledged == {"config": "ab", "by": "page@page", "id": "sensor.t3.open_circuit"}
        other = {**alarm, "id": "b", "severity": "minor", "reason": "another"}
        feed.document(
            "alarms", {**DOCUMENTS["alarms"], "alarms": [other, {**alarm, "state": "acknowledged"}]}
        )
        page.wait_for_function("() => document.querySelector('#hero-alarm b').textContent === 'another'")
        feed.document("alarms", {**DOCUMENTS["alarms"], "alarms": [{**alarm, "state": "acknowledged"}]})
        page.wait_for_selector("#hero-alarm [data-state=acknowledged]")
        assert page.locator("#hero-alarm button").count() == 0
        assert page.is_visible("#hero-alarm b")
        feed.document("alarms", {**DOCUMENTS["alarms"], "alarms": []})
        page.wait_for_selector("#hero-alarm", state="hidden")
    finally:
        feed.document("alarms", DOCUMENTS["alarms"])
    page.wait_for_selector("#hero-alarm button")


def test_the_cursor_reads_value_sigma_and_bound(opened):
    page = opened()
    _over(page, "#c-heats", 0.5)
    read = page.wait_for_selector("#c-heats + .readout:not(:empty)").inner_text()
    value = float(read.split("nut ")[1].split()[0])
    assert read.endswith(f"nut {value:.1f} ± 0.5 W, bound 3.0 W")
    assert abs(value - 10.0 - ROWS / 2) < 6
    _over(page, "#c-map", 0.5)
    read = page.wait_for_selector("#c-map + .readout:not(:empty)").inner_text()
    assert "26.00 ± 0.10 °C, bound 0.50 K, at 500 mm" in read
    page.focus("#c-error")
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    read = "500 mm: 20.0 ± 1.0 µm, bound 5.0 µm"
    page.wait_for_function(f"() => document.querySelector('#c-error + .readout').innerText === '{read}'")


def test_a_view_is_zoomed_linked_restored_and_reset(opened):
    page = opened()
    page.click("#c-heats .u-over")
    _over(page, "#c-heats", 0.5)
    for _ in range(3):
        page.mouse.wheel(0, -100)
    page.wait_for_function("() => location.hash.includes('from=')")
    page.click("#p2 .tools button:text-is('Link')")
    page.wait_for_function("() => document.querySelector('#p2 .tools').innerText.includes('Copied')")
    link = page.evaluate("() => navigator.clipboard.readText()")
    seen = _table(_saved(page, "p2", "CSV"))
    assert 100 < len(seen) < 200
    other = opened(link)
    other.wait_for_function("() => document.activeElement.id === 'p2'")
    assert _table(_saved(other, "p2", "CSV")) == seen
    assert other.evaluate("() => location.href") == link
    other.dblclick("#c-heats .u-over")
    assert len(_table(_saved(other, "p2", "CSV"))) >= ROWS


def test_a_dragged_chart_moves(opened):
    page = opened(f"#panel=p2&from={PAST[100]['time_s']}&to={PAST[200]['time_s']}")
    page.wait_for_function("() => document.activeElement.id === 'p2'")
    before = _table(_saved(page, "p2", "CSV"))
    _over(page, "#c-heats", 0.3)
    page.mouse.down()
    _over(page, "#c-heats", 0.6)
    page.mouse.up()
    after = _table(_saved(page, "p2", "CSV"))
    assert float(before[0]["time_s"]) - float(after[0]["time_s"]) == pytest.approx(
        30 * STEP_S, abs=3 * STEP_S
    )


def test_two_fingers_zoom_and_one_moves(opened):
    page = opened()
    page.locator("#c-heats").scroll_into_view_if_needed()
    box = page.locator("#c-heats .u-over").bounding_box()
    touch = page.context.new_cdp_session(page)

    def send(kind: str, *shares: float) -> None:
        y = box["y"] + box["height"] / 2
        points = [{"x": box["x"] + s * box["width"], "y": y, "id": k} for k, s in enumerate(shares)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def rows() -> list[float]:
        return [float(row["time_s"]) for row in _table(_saved(page, "p2", "CSV"))]

    send("touchStart", 0.4, 0.6)
    for apart in (0.15, 0.2, 0.25):
        send("touchMove", 0.5 - apart, 0.5 + apart)
    send("touchEnd")
    page.wait_for_function("() => location.hash.includes('from=')")
    zoomed = rows()
    # fingers 0.2 of the width apart are 0.5 apart at the end
    assert len(zoomed) == pytest.approx(ROWS * 0.4, abs=ROWS * 0.05)
    send("touchStart", 0.3)
    for share in (0.4, 0.5, 0.6):
        send("touchMove", share)
    send("touchEnd")
    moved = rows()
    assert len(moved) == pytest.approx(len(zoomed), abs=2)
    assert moved[0] < zoomed[0] - 0.2 * (zoomed[-1] - zoomed[0])
    assert page.inner_text("#c-heats + .readout").count("nut ") == 1


def test_saved_files_hold_the_shown_data(opened):
    page = opened()
    heats = _table(_saved(page, "p2", "CSV"))[:ROWS]
    assert [float(row["heat_nut_W"]) for row in heats] == [row["heat_W"]["nut"] for row in PAST]
    assert [float(row["time_s"]) for row in heats] == [row["time_s"] for row in PAST]
    assert {row["heat_nut_bound_W"] for row in heats} == {"3"}
    field = _table(_saved(page, "p1", "CSV"))[:ROWS]
    assert [float(row["field_0_degC"]) for row in field] == [row["temperature_degC"][0] for row in PAST]
    along = _table(_saved(page, "p3", "CSV"))
    assert [float(row["error_um"]) for row in along] == ERROR["error_um"]
    assert [float(row["position_mm"]) for row in along] == [1000 * x for x in PLACES_M]
    (alarm,) = _table(_saved(page, "p5", "CSV"))
    assert alarm["remedy"] == "fix the cable"
    (sensor,) = _table(_saved(page, "p4", "CSV"))
    assert (sensor["sensor"], sensor["reading"]) == ("t3", "36")
    ahead = _table(_saved(page, "p6", "CSV"))
    assert [float(row["expected_um"]) for row in ahead] == [41.0, 50.0, 52.0]


@pytest.mark.parametrize("panel", ["p1", "p2", "p3", "p4", "p5", "p6", "p7"])
def test_a_picture_shows_something(opened, panel):
    from matplotlib.image import imread

    picture = imread(io.BytesIO(_saved(opened(), panel, "PNG")))
    assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 20


def test_a_hundred_thousand_points_are_trends_with_their_mean(opened):
    page = opened(f"#panel=p8&from={NOW_S - 2 * POINTS}&to={NOW_S}")
    page.wait_for_selector("#c-past[data-from] [data-unit=degC] canvas", timeout=PATIENCE_S * 1000)
    assert page.inner_text("#machine") == MACHINE
    found = [row for row in _table(_saved(page, "p8", "CSV")) if row["t3_degC_mean"]]
    assert 200 <= len(found) <= 800
    for row in found[2:-2]:
        assert float(row["t3_degC_least"]) == 20.0
        assert float(row["t3_degC_most"]) == 119.0
        # a saw of 100 values, and r more at worst all at one end: r (100 - r) / 2 / (100 + r) is at most 8.6
        assert float(row["t3_degC_mean"]) == pytest.approx(69.5, abs=8.6)
    assert page.evaluate("() => document.querySelector('[data-unit=m] + .readout') !== null")
