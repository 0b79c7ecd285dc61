"""What the page shows of what is not there: a sensor that fell out, a law, a forecast, the service itself."""

from __future__ import annotations

from contextlib import closing, contextmanager

import pytest

from tests.page.browser import IN_A_BROWSER
from tests.page.served import DOCUMENTS, HEAD, estimate, send_all, served_page

pytestmark = IN_A_BROWSER

# what is written on canvases, each text with its colour
WRITTEN = """
window.written = [];
const fill = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
  written.push([String(text), this.fillStyle]); return fill.call(this, text, ...at);
};
"""
WITHOUT_FORECAST = {key: said for key, said in DOCUMENTS.items() if key != "forecast"}


def _readings(quality: str, age_s: float) -> dict:
    channels = {
        "t3_degC": {"value": 36.0, "quality": quality, "age_s": age_s},
        "nut_position_m": {"value": 0.4, "quality": quality, "age_s": age_s},
    }
    return {**HEAD, "channels": channels}


@contextmanager
def _page(browser, **more):
    with served_page(documents=WITHOUT_FORECAST, **more) as (url, feed), closing(browser.new_page()) as page:
        page.add_init_script(WRITTEN)
        page.goto(url)
        page.wait_for_selector("tr[data-sensor=t3]")
        yield page, feed


@pytest.mark.parametrize(
    ("quality", "word"), [("rejected", "rejected"), ("missing", "no reading"), ("stale", "stale")]
)
def test_a_sensor_that_fell_out_is_crossed_out_on_the_screw(browser, quality, word):
    with _page(browser) as (page, feed):
        feed.document("readings", _readings("good", 0.0))
        send_all(feed, {}, estimate(8).replace(b"gmissing", b"dgood"))
        page.wait_for_function("() => written.some(([text]) => text === 't3 36.0')")
        assert "now 25.0 to 27.0 °C, nut at 400 mm" in page.get_attribute("#screw", "aria-label")
        page.wait_for_timeout(200)  # of what comes faster than ten times a second the page leaves some out
        feed.document("readings", _readings(quality, 660.0))
        page.wait_for_function(
            "() => document.getElementById('screw')"
            f".ariaLabel.endsWith('nut at – mm; crossed out: t3 {word}')"
        )
        assert page.inner_text("#crossed") == f"Crossed out: t3 {word}."
        page.evaluate("() => { written.length = 0; dispatchEvent(new Event('resize')); }")
        page.click("#theme")
        page.wait_for_function(f"() => written.some(([text]) => text === 't3 {word}')")
        assert not page.evaluate("() => written.some(([text]) => text.includes('36.0'))")
        bad, ink = page.evaluate(
            """() => { const root = getComputedStyle(document.documentElement);
              return ['--bad', '--ink'].map(name => root.getPropertyValue(name)); }"""
        )
        colours = page.evaluate(f"() => written.filter(([text]) => text === 't3 {word}').map(([, c]) => c)")
        assert colours[-1] == bad.strip() != ink.strip()
        row = page.locator("tr[data-sensor=t3]")
        assert row.locator("[data-field=reading]").inner_text() == "36.00 °C"
        assert "11 min old" in row.inner_text()
        assert row.locator("td[data-late]").first.is_visible()
        assert page.inner_text("#f-nut") == "– position lost"


def test_a_source_without_a_law_has_none_of_0_W(browser):
    with _page(browser, law_W=0.0) as (page, _):
        assert page.inner_text("[data-heat=nut]") == "26.5 ± 0.6 W"
        assert page.inner_text("[data-law=nut]") == ""
    with _page(browser, law_W=0.0, laws=("nut",)) as (page, _):
        page.wait_for_function("() => document.querySelector('[data-law=nut]').textContent === ' law 0.0 W'")


@pytest.mark.parametrize(
    ("forecast_s", "said"),
    [
        (
            None,
            "No forecast comes: every estimated heat needs a law, or [forecast] enabled is false.",
        ),
        (60.0, "No forecast yet: a new one comes every 60 s."),
        (600.0, "No forecast yet: a new one comes every 10 min."),
    ],
)
def test_a_forecast_is_promised_where_one_comes(browser, forecast_s, said):
    with _page(browser, forecast_s=forecast_s) as (page, _):
        page.wait_for_function(
            "() => document.getElementById('forecast-words').textContent !== 'No forecast yet.'"
        )
        assert page.inner_text("#forecast-words") == said


def test_of_a_service_that_is_gone_nothing_runs_on(browser):
    with _page(browser) as (page, feed):
        feed.document("health", {**DOCUMENTS["health"], "state": "stale"})
        page.wait_for_function("() => document.getElementById('words').textContent.includes('runs alone')")
        # two periods of 60 s of this service later
        page.evaluate(
            "() => { const now = performance.now.bind(performance); performance.now = () => now() + 2e5; }"
        )
        page.wait_for_selector("[data-silent]")
        assert page.inner_text("#state") == "Stale"
        said = page.inner_text("#words")
        assert said == "Nothing comes from the service; what is shown is the last that it said."


@pytest.mark.parametrize(
    ("unused", "known_to_um", "headline"),
    [
        ([], None, "Good"),
        (["right_housing"], None, "Good, but without right_housing (4 of 5 sensors)"),
        ([], 4.9, "Good to ±5 µm at the nut"),
    ],
)
def test_a_good_headline_names_the_sensors_that_are_not_used(browser, unused, known_to_um, headline):
    counts = {"sensors_used": 5 - len(unused), "sensors": 5, "degraded_sensors": unused}
    counts |= {"error_known_to_um": known_to_um}
    with _page(browser) as (page, feed):
        feed.document(
            "health",
            {**HEAD, "state": "good", "quality": "good", "reasons": [], "channels": {}} | counts,
        )
        page.wait_for_function(f"() => document.getElementById('state').textContent === {headline!r}")
        assert headline in page.title()
