"""The page in a real browser, of a real service: what it shows, what it asks for, and when it says STALE."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.page.browser import IN_A_BROWSER, PERIOD_S, SIZES, complaints, seconds_until, service
from tests.patience import until
from tests.system.plant import children_of

pytestmark = IN_A_BROWSER

SLACK_S = 1.5  # 0.4 s of the page's own, and a busy computer
SHOWN = """() => ({
  sequence: Number(document.getElementById('heats').dataset.sequence),
  heats: Object.fromEntries([...document.querySelectorAll('[data-heat]')]
    .map(e => [e.dataset.heat, e.textContent])),
  readings: Number(document.getElementById('sensors').dataset.sequence),
  estimate: Number(document.getElementById('sensors').dataset.estimate),
  sensors: Object.fromEntries([...document.querySelectorAll('tr[data-sensor]')].map(e => [e.dataset.sensor,
    [...['reading', 'innovation', 'quality'].map(f => e.querySelector(`[data-field=${f}]`).textContent),
      Number(e.querySelector('[data-field=innovation]').dataset.sequence)]])),
})"""


def _as_shown(value: float, digits: int) -> float:
    """A number as the page rounds it; halves may go either way."""
    return pytest.approx(value, abs=0.5 * 10**-digits + 1e-6, nan_ok=True)


def _number(text: str) -> float:
    return float(text.split(maxsplit=1)[0].replace("\N{MINUS SIGN}", "-"))


@pytest.fixture(scope="module")
def served(tmp_path_factory, browser):
    """A service, and a page of it that has been open for a while."""
    with service(tmp_path_factory.mktemp("page")) as (url, daemon, seen):
        page = browser.new_page(viewport=dict(zip(("width", "height"), SIZES["desktop"], strict=True)))
        problems, requests = complaints(page), []
        page.on("request", lambda request: requests.append(request.url))
        page.goto(url)
        page.wait_for_selector("tr[data-sensor]")
        yield {"url": url, "daemon": daemon, "seen": seen, "page": page,
               "problems": problems, "requests": requests}  # fmt: skip


def test_the_page_shows_the_numbers_that_zenoh_carries(served):
    page, seen = served["page"], served["seen"]
    page.wait_for_function("() => Number(document.getElementById('heats').dataset.sequence) > 2")
    shown = page.evaluate(SHOWN)

    def of(key: str, sequence: int):
        return next((d for d in seen.documents.get(key, []) if d["sequence"] == sequence), None)

    heat = until(lambda: of("heat", shown["sequence"]))
    assert shown["heats"].keys() == heat["sources"].keys()
    for name, text in shown["heats"].items():
        value, _, sigma, unit = text.replace("\N{MINUS SIGN}", "-").split()
        assert float(value) == _as_shown(heat["sources"][name]["heat_W"], 1)
        assert float(sigma) == _as_shown(heat["sources"][name]["sigma_W"], 1)
        assert unit == "W"
    readings = until(lambda: of("readings", shown["readings"]))

    def estimated(sequence: int):
        return until(lambda: next((e for e in seen.estimates if e["sequence"] == sequence), None))

    estimate = estimated(shown["estimate"])
    assert list(shown["sensors"]) == estimate["sensors"]
    for i, (name, (reading, innovation, quality, reported_at)) in enumerate(shown["sensors"].items()):
        assert _number(reading) == _as_shown(readings["channels"][f"{name}_degC"]["value"], 2)
        assert _number(innovation) == _as_shown(float(estimated(reported_at)["innovation_K"][i]), 3)
        assert quality == estimate["sensor_quality"][i]


def test_a_sensor_that_is_read_every_other_step_does_not_flicker(served):
    page, sensors = served["page"], []
    page.wait_for_function(
        "() => document.querySelectorAll('[data-field=innovation][data-sequence]').length > 4"
    )
    begin = len(served["seen"].estimates)
    page.evaluate("""() => {
      window.dashes = new Set(); window.steps = new Set();
      new MutationObserver(() => {
        steps.add(document.getElementById('sensors').dataset.estimate);
        for (const e of document.querySelectorAll('[data-field=innovation]'))
          if (e.textContent.startsWith('\u2013')) dashes.add(e.closest('tr').dataset.sensor);
      }).observe(document.getElementById('sensors'), { childList: true, attributes: true });
    }""")
    page.wait_for_function("() => steps.size > 8")
    for estimate in served["seen"].estimates[begin:]:
        sensors += np.isnan(estimate["innovation_K"]).tolist()
    assert any(sensors), "every step had a reading: this test shows nothing"
    assert page.evaluate("() => [...dashes]") == []


def test_the_page_asks_its_own_server_only_and_complains_of_nothing(served):
    served["page"].wait_for_timeout(500)
    assert served["requests"]
    assert [r for r in served["requests"] if not r.startswith((served["url"], "data:"))] == []
    assert served["problems"] == []


@pytest.mark.parametrize("who", ["service", "outlets"])
def test_the_page_says_stale_while_service_or_outlets_are_frozen(served, who):
    page, pid = served["page"], served["daemon"].process.pid
    if who == "outlets":
        (pid,) = [child for child in children_of(pid) if "observer.outlets" in _command(child)]
    until(lambda: page.evaluate("() => document.getElementById('stale').hidden"))
    os.kill(pid, signal.SIGSTOP)
    try:
        took_s = seconds_until(page, "() => !document.getElementById('stale').hidden")
        assert page.evaluate("() => document.body.dataset.state") == "stale"
        assert "STALE" in page.inner_text("#stale")
    finally:
        os.kill(pid, signal.SIGCONT)
    assert took_s <= 2 * PERIOD_S + SLACK_S
    seconds_until(page, "() => document.getElementById('stale').hidden")
    # the service itself may say so for a moment: what it reads has become old meanwhile
    seconds_until(page, "() => document.body.dataset.state !== 'stale'")


def test_the_controls_of_the_page_work_from_the_keyboard_and_bare_keys_do_nothing(served):
    page = served["page"]
    page.wait_for_function("() => Number(document.getElementById('moment').max) > 1")
    theme = "() => document.documentElement.dataset.theme ?? ''"
    before = page.evaluate(theme)
    page.evaluate("() => document.activeElement.blur()")
    for key in ("4", "t", "?", "Space"):
        page.keyboard.press(key)
    assert page.evaluate("() => document.activeElement === document.body")
    assert page.evaluate(theme) == before
    assert page.get_attribute("#pause", "aria-pressed") == "false"
    page.focus("#pause")
    page.keyboard.press("Enter")
    page.wait_for_selector("#pause[aria-pressed=true]")
    held = page.inner_text("#moment-said")
    page.focus("#moment")
    page.keyboard.press("ArrowLeft")
    page.wait_for_function(f"() => document.getElementById('moment-said').textContent !== '{held}'")
    page.focus("#pause")
    page.keyboard.press("Enter")
    page.wait_for_selector("#pause[aria-pressed=false]")
    page.focus("#theme")
    page.keyboard.press("Enter")
    assert page.evaluate(theme) != before


def test_the_recording_is_looked_back_on_and_laid_over_itself(served):
    page = served["page"]
    page.locator("#p8").scroll_into_view_if_needed()
    page.wait_for_selector("#c-past [data-unit=degC] canvas")
    assert page.locator("#c-past [data-unit]").count() >= 3
    page.select_option("#over", "3600")
    page.wait_for_selector("#c-past[data-over='3600']")
    start = page.get_attribute("#c-past", "data-from")
    page.click("#earlier")
    page.wait_for_function(f"() => document.getElementById('c-past').dataset.from !== '{start}'")


def _command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")
