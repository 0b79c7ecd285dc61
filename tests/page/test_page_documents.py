"""A page of made-up documents in a real browser: alarms, forecast, compensation, login."""

from __future__ import annotations

import csv
import itertools
from contextlib import closing
from pathlib import Path

import pytest

from tests.bus.people import Authority, secret
from tests.page.browser import IN_A_BROWSER, SIZES, complaints
from tests.page.served import DOCUMENTS, NASTY, crowd, crowd_estimate, estimate, send_all, served_page
from tests.patience import PATIENCE_S, until

pytestmark = IN_A_BROWSER


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    """A page by TLS for those who log in: its address, the authority's certificate, and the bus."""
    folder = tmp_path_factory.mktemp("tls")
    ours = Authority(folder)
    users = secret(folder / "users", "anna:right\n")
    with served_page(ours.ca, users_file=users, **ours.sign("page")) as (url, feed):
        yield url, ours.ca, feed


@pytest.fixture(scope="module")
def anna(browser, sealed):
    """Somebody who has logged in, in a browser that trusts its own authorities only."""
    context = browser.new_context(ignore_https_errors=True)
    with closing(context.new_page()) as page:
        page.goto(sealed[0])
        page.fill("[name=user]", "anna")
        page.fill("[name=password]", "right")
        page.keyboard.press("Enter")
        page.wait_for_selector("#p0")
    return context


@pytest.fixture
def crowded(anna, sealed):
    """A page of a machine with much to say."""
    url, _, feed = sealed
    send_all(feed, crowd(), crowd_estimate())
    with closing(anna.new_page()) as page:
        page.goto(url)
        page.wait_for_function("() => document.querySelectorAll('[data-alarm]').length === 3")
        page.wait_for_function("() => document.querySelectorAll('tr[data-sensor]').length === 12")
        page.wait_for_function("() => document.querySelectorAll('[data-heat]').length === 6")
        yield page


def test_documents_are_shown_and_never_run(anna, sealed):
    url, _, feed = sealed
    send_all(feed, DOCUMENTS, estimate(7))
    with closing(anna.new_page()) as page:
        problems = complaints(page)
        page.goto(url)
        page.wait_for_selector("#c-forecast canvas")
        page.wait_for_selector("tr[data-sensor=t3]")
        assert page.inner_text("#state") == "Degraded"
        assert page.inner_text("#hero-alarm b") == NASTY
        assert page.inner_text("#reasons") == ""  # which the alarm says already
        assert page.locator("main img").count() == 0
        assert "open circuit" in page.inner_text("#sensors")
        assert page.inner_text("tr[data-sensor=t3] [data-field=reading]") == "– °C"
        assert page.inner_text("[data-heat=nut]") == "26.5 ± 0.6 W"
        assert page.inner_text("[data-learnt='surface.convection_W_m2K']") == "15.22 ± 0.42"
        assert page.inner_text("#comp-words") == "compensation armed"
        assert "Settled within 2.0 µm" in page.inner_text("#forecast-words")
        assert "The last cycle goes on" in page.inner_text("#forecast-words")
        assert ", between " in page.inner_text("#forecast-words")
        assert "1.12 ± 0.04" in page.inner_text("#alarms")
        assert "still learning what is usual: 12.3 of 30 h of running" in page.inner_text("#alarms")
        assert "observer acknowledge sensor.t3.open_circuit" in page.inner_text("#alarms")
        page.click("#alarms button")
        assert feed.acknowledged.get(timeout=PATIENCE_S) == {
            "config": "ab",
            "by": "anna@page",
            "id": "sensor.t3.open_circuit",
        }
        feed.document("alarms", {**DOCUMENTS["alarms"], "alarms": []})
        page.wait_for_selector("#alarms .calm")
        assert problems == []


def _compensation(**changes) -> dict:
    return DOCUMENTS["compensation"] | changes


def _drawn_um(page) -> list[float | None]:
    """What the panel of the error draws as the compensation, at its places."""
    with page.expect_download() as saved:
        page.click("#p3 .tools button:text-is('CSV')")
    rows = csv.DictReader(Path(saved.value.path()).read_text(encoding="utf-8-sig").splitlines())
    return [float(row["compensation_um"]) if row["compensation_um"] else None for row in rows]


@pytest.mark.parametrize("reverse", [False, True])
def test_the_compensation_is_drawn_along_the_screw_with_the_sign_of_the_error(anna, sealed, reverse):
    """The error is 0, 20 and 41 µm at 0, 0.5 and 1 m of the screw; the machine's zero is at 1 m or at 0."""
    url, _, feed = sealed
    config = {"compensation": {"reverse": reverse, "zero_m": 1.0 if reverse else 0.0}}
    table = {"error_um": [-40.0, -19.0, -1.0] if reverse else [1.0, 19.0, 40.0]}
    documents = DOCUMENTS | {
        "config": {"config": DOCUMENTS["config"]["config"] | config},
        "compensation": _compensation(**table),
    }
    with closing(anna.new_page()) as page:
        page.goto(url)
        send_all(feed, documents, estimate(7))
        page.wait_for_selector("#c-error canvas")
        until(lambda: _drawn_um(page) == [1.0, 19.0, 40.0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gradient_cut_um": 12.34}, "compensation armed; the gradient limit of 100 µm/m cuts up to 12.3 µm"),
        (
            {"phase": "holding", "hold_reason": "no position"},
            "compensation holds its last values: no position",
        ),
        ({"armed": False, "phase": "releasing", "reason": "late"}, "compensation goes to zero: late"),
        ({"armed": False, "phase": "off", "reason": "late", "position_m": None}, "compensation off: late"),
    ],
)
def test_the_page_says_what_the_compensation_does(anna, sealed, changes, words):
    url, _, feed = sealed
    with closing(anna.new_page()) as page:
        page.goto(url)
        send_all(feed, DOCUMENTS | {"compensation": _compensation(**changes)}, estimate(7))
        until(lambda: page.inner_text("#comp-words") == words)


def test_good_estimates_with_a_released_compensation_are_good_and_the_headline_says_so(anna, sealed):
    url, _, feed = sealed
    reason = "switched off at 04:11:01: no position from the control for 0.4 s; arm again"
    off = _compensation(armed=False, phase="off", reason=reason, released_s=1.0, position_m=None)
    health = DOCUMENTS["health"] | {"state": "good", "reasons": [f"compensation {reason}"]}
    with closing(anna.new_page()) as page:
        page.goto(url)
        send_all(feed, DOCUMENTS | {"compensation": off, "health": health}, estimate(7))
        until(lambda: page.inner_text("#words") == f"Estimates are good. Compensation is off: {reason}")
        assert page.inner_text("#state") == "Good"


def test_long_and_numerous_texts_stay_in_their_panel(crowded):
    # of panels none has anything cut off, and of tables no last column is out of sight
    out = """() => [...document.querySelectorAll(
      'html, header, .hero, .panel, .tools, h2, .scroll, #heats, #crossed')]
      .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.id || e.className || e.tagName)"""
    for size, (width, height) in SIZES.items():
        crowded.set_viewport_size({"width": width, "height": height})
        crowded.wait_for_function(f"() => innerWidth === {width}")
        assert crowded.evaluate(out) == [], size


def test_the_keyboard_goes_through_the_page_in_the_order_that_is_seen(crowded):
    width, height = SIZES["phone"]  # one column
    crowded.set_viewport_size({"width": width, "height": height})
    crowded.evaluate("() => { document.activeElement.blur(); scrollTo(0, 0); }")
    seen = []
    for _ in range(40):
        crowded.keyboard.press("Tab")
        at = crowded.evaluate("""() => {
          const e = document.activeElement, box = e.getBoundingClientRect();
          const sticks = e.closest('.top, .skip') !== null;
          return e === document.body ? null : [sticks ? 0 : box.top + scrollY,
            getComputedStyle(e).outlineStyle === 'solid' || e.id.includes('until')];
        }""")
        if at is None:
            break
        seen.append(at)
    tops = [top for top, _ in seen]
    assert len(seen) > 12
    assert all(after >= before - 40 for before, after in itertools.pairwise(tops))  # buttons of a row
    assert all(marked for _, marked in seen)


def test_the_page_does_not_move_where_the_reader_wants_no_motion(crowded):
    crowded.emulate_media(reduced_motion="reduce")
    assert crowded.evaluate("() => getComputedStyle(document.documentElement).scrollBehavior") == "auto"
    moving = "() => document.getAnimations().length"
    crowded.click("#theme")
    assert crowded.evaluate(moving) == 0
    crowded.emulate_media(reduced_motion="no-preference")
    assert crowded.evaluate("() => getComputedStyle(document.documentElement).scrollBehavior") == "smooth"


def test_a_browser_logs_in_and_out_over_tls(browser, sealed):
    url, _, feed = sealed
    send_all(feed, DOCUMENTS, estimate(7))
    with closing(browser.new_page(ignore_https_errors=True)) as page:
        page.goto(url)
        # what is right came by the stream of events
        for password, seen in (("wrong", ".wrong:not(:empty)"), ("right", "tr[data-sensor=t3]")):
            page.fill("[name=user]", "anna")
            page.fill("[name=password]", password)
            page.keyboard.press("Enter")
            page.wait_for_selector(seen)
        (cookie,) = page.context.cookies()
        assert cookie["secure"]
        assert page.evaluate("() => isSecureContext")
        page.click("#logout button")
        page.wait_for_selector("[name=password]")
        assert page.locator(".plain").count() == 0
