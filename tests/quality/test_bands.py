"""What is learnt of a heat, on machines of an own truth, and that wear is noticed before it is dear."""

from __future__ import annotations

import math

import pytest

from campaigns.alarms.months import Story
from campaigns.alarms.trial import watched
from observer.quality import bands
from observer.quality.bands import Window


def _window(hour: float, heat_W: float, law_W: float = 10.0, rise_K: float = 5.0) -> Window:
    return Window(3600.0 * hour, heat_W, 0.5, law_W, rise_K, 12.0)


def _learnt(heats, law_W: float = 10.0):
    band = bands.nothing_known()
    for k, heat_W in enumerate(heats):
        band = bands.learnt(band, _window(k / 6.0, heat_W, law_W), 30.0, 0.25)
    return band


def test_a_heat_off_its_law_is_usual_once_learnt():
    band = _learnt([13.0] * 300)
    assert band.side == 0
    assert math.exp(band.left) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("factor", "side"), [(1.15, 0), (1.6, 1), (0.55, -1)])
def test_a_departure_from_the_usual_is_reported_and_not_learnt_away(factor, side):
    band = _learnt([13.0] * 200 + [13.0 * factor] * 600)
    assert band.side == side
    assert math.exp(band.left) == pytest.approx(factor, rel=0.05)


def test_nothing_is_reported_before_the_usual_is_known():
    assert _learnt([13.0] * 100 + [26.0] * 60).side == 0


def test_an_uninformative_window_is_left_out():
    band = _learnt([13.0] * 50)
    assert bands.learnt(band, _window(9.0, 90.0, law_W=0.5), 30.0, 0.25) == band
    unsure = bands.learnt(band, _window(9.0, 13.0)._replace(sigma_W=8.0), 30.0, 0.25)
    assert unsure._replace(unsure_h=0.0, unsure=0.0) == band


@pytest.mark.parametrize("before", [0, 300], ids=["never learnt", "learnt before"])
def test_a_heat_that_is_too_uncertain_to_learn_gives_the_reason_until_it_is_not(before):
    band = _learnt([13.0] * before)
    for k in range(7):
        assert bands.why_unsure(band) is None or k >= 6
        band = bands.learnt(band, _window(60.0 + k / 6.0, 13.0)._replace(sigma_W=9.75), 30.0, 0.25)
    assert "uncertain by 75% of the heat (σ), and 30% is needed" in bands.why_unsure(band)
    assert bands.why_unsure(bands.band_of(bands.plain_of(band))) == bands.why_unsure(band)
    assert bands.why_unsure(bands.learnt(band, _window(70.0, 13.0), 30.0, 0.25)) is None


def test_a_band_that_an_earlier_service_kept_is_taken_over():
    plain = bands.plain_of(_learnt([13.0] * 50))
    del plain["unsure_h"], plain["unsure"]
    assert bands.band_of(plain).running_h == pytest.approx(50 / 6.0)


def test_the_trend_is_that_of_a_heat_that_grows():
    band = _learnt([13.0] * 200)
    for k in range(600):
        hour = 40.0 + k / 6.0
        band = bands.learnt(band, _window(hour, 13.0 * math.exp(0.03 * k / 144.0)), 30.0, 0.25)
    assert bands.trend_per_day(band) == pytest.approx(0.03, rel=0.15)
    assert bands.trend_per_day(bands.nothing_known()) is None


@pytest.mark.parametrize("seed", [1, 2])
def test_months_in_which_nothing_happens_are_quiet(seed):
    seen = watched(Story(days=30), seed)
    assert seen.quiet_d > 15.0
    assert seen.false <= 1


@pytest.mark.parametrize("seed", [1, 2])
def test_bearing_wear_is_reported_a_day_of_running_before_its_heat_has_doubled(seed):
    seen = watched(Story(begins_h=60.0, doubles_h=200.0), seed)
    assert seen.early_h > 24.0


@pytest.mark.parametrize("seed", [1, 2])
def test_loss_of_preload_is_reported_before_the_heat_has_halved(seed):
    seen = watched(Story(begins_h=100.0, lost=0.75, loses_h=200.0), seed)
    assert seen.left > 0.5


def test_what_friction_falls_by_early_is_running_in_and_later_is_not():
    # a tenth less than what was learnt, at once or a hundred hours of running later, and then a fifth more
    early, late = _learnt([13.0] * 200 + [11.7] * 700), _learnt([13.0] * 800 + [11.7] * 100)
    for k in range(200):
        window = _window(200.0 + k / 6.0, 9.6)
        early, late = (bands.learnt(band, window, 30.0, 0.25) for band in (early, late))
    assert early.side == 0
    assert late.side == -1


@pytest.mark.parametrize("harmless", [{"slower": 0.5}, {"rest_d": 14}, {"stiff": 0.33}])
def test_slower_parts_a_holiday_and_stiff_grease_are_no_fault(harmless):
    assert watched(Story(days=45, begins_h=60.0, **harmless), 3).false == 0
