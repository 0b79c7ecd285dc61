"""What a search comes to and how it is proved: every bound from both sides, on written records."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.discovery.proof import Proof, SensorError, prove, proves
from observer.discovery.search import FittedCandidate, Search
from observer.discovery.verdict import alternatives, decide, goodness
from observer.fit.evidence import PROOF
from observer.fit.hypothesis import Fit
from observer.fit.parameters import FILM, get, with_values
from tests.discovery.written import CONFIG, fit, left, problem, tolerance, trial

ROWS = 1000
NOISE = 0.3
"""What noise alone makes of the mean squared whitened error."""
EPSILON = 1e-6
# The bounds in figures: a test that asked the code for them would follow it anywhere.
FORM, UNFIT, PROOF_UNFIT, WORSE, NOTICED = 0.01, 0.12, 0.3, 1.2, 0.4
BIAS = {"kind": "sensor_bias", "target": "b", "offset_K": 0.8}


def rival(target: str, drop: float, **changes: Any) -> FittedCandidate:
    return trial(target, drop, left(NOISE, BIAS), **changes)


def search(*rivals: tuple[FittedCandidate, ...], null: float = 2.0, after: float = NOISE) -> Search:
    """A search whose winners lead their rivals; `after` is what its fit leaves."""
    return Search(left(null), left(after), tuple(r[0] for r in rivals), rivals, (), (), ())


NUT = search((rival("nut", 50.0),))


def gap(
    before: float = 2.0,
    after: float = NOISE,
    raw_K: tuple[float, float] = (1.0, 0.5),
    beyond_K: tuple[float, float] = (1.0, 0.5),
) -> SensorError:
    """A gap by its whitened squares, as measured, and beyond tolerances; its form is known to 0.05 K."""
    return SensorError(*raw_K, 0.01, before, after, beyond_K, 0.05)


def proof(
    after: float = NOISE, *, sensors: tuple[SensorError, ...] = (), unproved: tuple[str, ...] = ()
) -> Proof:
    each = {f"t{i}": sensor for i, sensor in enumerate(sensors)}
    return Proof(gap(after=after), each, 1.0, NOISE, unproved)


def test_goodness_is_the_mean_of_what_is_used() -> None:
    assert goodness(left(0.25)) == pytest.approx(0.25)
    assert goodness(left(0.0, rows=0)) == 0.0


@pytest.mark.parametrize("over", [False, True])
@pytest.mark.parametrize("where", ["fitted", "held back"])
def test_what_is_left_beyond_noise_and_a_hundredth_of_what_was_explained_is_unknown(
    where: str, *, over: bool
) -> None:
    null, sign, remaining = 5.0, 1 if over else -1, NOISE
    if where == "fitted":  # remaining = noise + UNFIT + FORM (null - remaining), solved for it
        remaining = (NOISE + UNFIT + FORM * null) / (1 + FORM) + sign * EPSILON
    bound = NOISE + PROOF_UNFIT + 2 * FORM * (null - remaining)
    after = bound + sign * EPSILON if where == "held back" else NOISE
    found = decide(search((rival("nut", 50.0),), null=null, after=remaining), proof(after), ())
    assert found.kind == ("unknown" if over else "named")
    if over:
        assert {"fitted": "in what was fitted", "held back": "on data held back"}[where] in found.reason
        assert (found.sets, found.fits) == ((), ())
        assert found.fit.deviance == pytest.approx(remaining * ROWS)


def test_a_sensor_that_is_predicted_worse_is_unknown_even_if_all_together_are_better() -> None:
    worse = gap(NOISE, 2 * NOISE + NOTICED)
    found = decide(NUT, proof(sensors=(worse,)), ())
    assert found.kind == "unknown"
    assert "on data held back" in found.reason


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [
        (1.0, WORSE + EPSILON, True),
        (1.0, WORSE - EPSILON, False),
        (0.1, NOISE + NOTICED + EPSILON, True),  # many times worse, but only now to be noticed
        (0.1, NOISE + NOTICED - EPSILON, False),
    ],
)
def test_worse_is_by_a_fifth_and_beyond_what_is_noticed(before: float, after: float, worse: bool) -> None:
    found = proof(sensors=(gap(before, after), gap(1.0, NOISE)))
    assert found.worse == (("t0",) if worse else ())


@pytest.mark.parametrize(
    ("raw_K", "beyond_K", "white", "grown"),
    [
        (0.05 + EPSILON, 0.05 + EPSILON, EPSILON, True),
        (0.05 + EPSILON, 0.05 + EPSILON, -EPSILON, False),  # within tolerances, then
        (0.05 + EPSILON, 0.05 - EPSILON, EPSILON, False),
        (0.05 - EPSILON, 0.05 + EPSILON, EPSILON, False),
        (-0.3, 0.2, EPSILON, False),
    ],
)
def test_a_sensor_whose_gap_grows_in_kelvin_beyond_its_form_is_unknown(
    raw_K: float, beyond_K: float, white: float, grown: bool
) -> None:
    """All together shrink; one grows, and 0.05 K are what no model of this form gets right."""
    before = NOISE + 0.1
    worse = gap(before, before + white, (0.4, 0.4 + raw_K), (0.2, 0.2 + beyond_K))
    found = proof(sensors=(worse, gap()))
    assert not found.worse
    assert found.grown_on == (("t0",) if grown else ())
    assert decide(NUT, found, ()).kind == ("unknown" if grown else "named")


@pytest.mark.parametrize(
    ("without_K", "with_K", "proved"),
    [
        (0.092, 0.12, False),  # a sensor's drift that was named on a measured rod
        (0.051, 0.052, False),  # and a sensor's lag
        (0.254, 0.238, False),  # a local heat where a sensor was off
        (0.1, 0.08 + EPSILON, False),
        (0.1, 0.08 - EPSILON, True),
        (0.02, 0.0175, False),
        (0.0141, 0.01, False),  # a fifth and more, but no more than the noise of 0.01 K
        (0.0142, 0.01, True),
        (0.0, 0.0, False),
        (0.5, 0.0, True),
    ],
)
def test_an_effect_proves_itself_by_a_fifth_of_the_gap_and_more_than_noise(
    without_K: float, with_K: float, *, proved: bool
) -> None:
    assert proves(without_K, with_K, 0.01) == proved


def test_a_sensor_that_is_left_with_noise_has_not_grown() -> None:
    left = gap(NOISE - 0.1, NOISE - EPSILON, (0.1, 0.4), (0.1, 0.4))
    assert proof(sensors=(left,)).grown_on == ()


def test_without_proof_of_each_effect_nothing_is_named() -> None:
    two = search((rival("loss", 50.0),), (rival("body", 40.0),))
    assert decide(two, proof(), ()).kind == "named"
    found = decide(two, proof(unproved=("body",)), ())
    assert (found.kind, found.unproved, found.sets) == ("unknown", ("body",), ())
    assert found.reason.startswith("body would explain")
    assert found.reason.endswith("by 20 % and more than noise with it")
    stretched = decide(two, replace(proof(unproved=("body",)), stretch=8.2), ())
    assert stretched.reason.endswith("one is off by 8 standard deviations leave as little")


def test_nothing_found_is_none_or_not_identifiable() -> None:
    nothing = search(null=NOISE)
    found = decide(nothing, proof(), ())
    assert (found.kind, found.sets, found.fit) == ("none", (), nothing.fit)
    assert "no missing effect" in found.reason
    lacking = decide(nothing, proof(), ("the log is short", "the screw never turns"))
    assert lacking.kind == "not_identifiable"
    assert lacking.reason.endswith("but the log is short; the screw never turns")


def test_what_was_found_is_named_whatever_the_logs_lack() -> None:
    found = decide(search((rival("a", 50.0),), (rival("b", 40.0),)), proof(), ("the log is short",))
    assert found.kind == "named"
    assert found.reason == "missing: sensor_bias at a and sensor_bias at b"
    assert [[c.target for c in each] for each in found.sets] == [["a", "b"]]


def sets(found: Search, noise: float = NOISE) -> list[str]:
    exchanged, fits = alternatives(found, noise)
    assert len(exchanged) == len(fits)
    assert fits[0] is found.fit
    return [" ".join(str(c.target) for c in each) for each in exchanged]


@pytest.mark.parametrize(
    ("drop", "after", "reach"),
    [
        (100.0, NOISE, 9.0),  # 2 % of the drop is less than nine
        (3000.0, NOISE, 9.0),  # 2 % of the drop is 60, but nothing is left unexplained
        (3000.0, NOISE + 0.01, 40.0),  # four times the 10 left unexplained
        (3000.0, NOISE + 0.1, 60.0),
        (3000.0, NOISE - 0.1, 9.0),  # less than noise is as good as noise
    ],
)
def test_a_rival_within_reach_cannot_be_distinguished_from_the_winner(
    drop: float, after: float, reach: float
) -> None:
    near, far = rival("near", drop - reach + EPSILON), rival("far", drop - reach - EPSILON)
    found = search((rival("winner", drop), near, far), after=after)
    assert sets(found) == ["winner", "near"]
    assert alternatives(found, NOISE)[1][1] is near.fit


def test_a_rival_that_was_not_accepted_or_is_the_same_physics_is_none() -> None:
    motor = trial("left", 100.0, left(NOISE), kind="motor_heat")
    at_the_end = left(NOISE, {"kind": "local_heat", "position_m": 0.001, "heat_W": 1.0})
    same, refused = trial("", 100.0, at_the_end, kind="local_heat"), rival("refused", 100.0, held_out=0.0)
    assert sets(search((motor, refused, same, rival("exactly nine behind", 91.0)))) == [
        "left", "exactly nine behind",
    ]  # fmt: skip


def test_one_effect_is_exchanged_in_its_own_place() -> None:
    first = (rival("a", 100.0), rival("x", 99.0))
    second = (rival("b", 50.0), rival("y", 49.0), rival("z", 48.0))
    found = search(first, second)
    assert sets(found) == ["a b", "x b", "a y", "a z"]
    said = decide(found, proof(), ())
    assert said.kind == "ambiguous"
    assert said.reason.replace("sensor_bias at ", "") == (
        "these logs cannot distinguish a and b from x and b from a and y from a and z"
    )
    assert said.fits[0] is said.fit is found.fit


# ---- the proof ----

SENSOR = np.array([0, 0, 0, 1, 1, 1, 1])
NOISE_K = np.array([0.1, 9.0, 0.1, 0.2, 0.2, 9.0, 0.2])
HELD_BACK = np.array([0, 2, 3, 4, 6])
ALLOWED_K = 0.5
"""One standard deviation of a tolerance that all sensors share; the fitted rows say that it is there."""


def proved(less_K: float | None = None, taken: float = 0.0) -> Proof:
    """The proof of a fit that predicts 0.5 K too little, where the calibrated model errs by 2 K; `less_K`: by
    how much one of fewer effects does. The film's figure is the error; of each, tolerances take a part.
    """
    whitened = [(np.flatnonzero(s == SENSOR), 0.5 * np.diag(1.0 / NOISE_K[s == SENSOR])) for s in (0, 1)]
    of = problem(
        [0 if row not in HELD_BACK else PROOF for row in range(7)],
        lambda config: np.full(7, -get(config, FILM)),
        sensor=SENSOR, noise_K=NOISE_K, groups=tuple(whitened),
    )  # fmt: skip
    of = replace(of, config=with_values(CONFIG, {FILM: 3.0}))
    if taken:
        column = np.full(7, ALLOWED_K)
        of = replace(of, nuisance=tolerance(column, of.evidence.whitened(column)))

    def leaves(off_K: float) -> Fit:
        """Its residual on the fitted rows lets the tolerance take a part of the error."""
        t = 0.5 * ALLOWED_K / 9.0
        needed = taken * off_K / ALLOWED_K * (2 * t**2 + 1.0) / (2 * t)
        return fit(of, np.full(7, needed), with_values(CONFIG, {FILM: off_K}))

    less = () if less_K is None else (("body", leaves(less_K)),)
    return prove(leaves(2.0), leaves(0.5), less)


@pytest.mark.parametrize(("less_K", "unproved"), [(0.12, True), (0.62, True), (-0.62, True), (0.63, False)])
def test_an_effect_is_unproved_where_the_others_alone_leave_as_little(
    less_K: float, *, unproved: bool
) -> None:
    """With it 0.45 K are beyond tolerances; nine tenths of 0.625 K are a quarter more."""
    found = proved(less_K, taken=0.1)
    assert found.unproved == (("body",) if unproved else ())
    assert found.stretch == pytest.approx(0.1 * abs(less_K) / ALLOWED_K if unproved else 0.0)


def test_what_tolerances_explain_is_taken_off_the_gap_and_costs_its_share_of_the_whitened_one() -> None:
    plain, found = proved(), proved(taken=0.1)
    assert plain.whole.beyond_tolerances_K == pytest.approx((2.0, 0.5))
    for each in (found.whole, *found.per_sensor.values()):
        assert each.beyond_tolerances_K == pytest.approx((1.8, 0.45))
    assert found.whole.after_rms_K == plain.whole.after_rms_K
    T = 0.5 * ALLOWED_K / NOISE_K[HELD_BACK]
    share = 1.0 / (1.0 + T @ T)  # of an error that is like the tolerance, (I + T Tᵀ)⁻¹ leaves this
    assert found.whole.before == pytest.approx(share * plain.whole.before)
    assert found.whole.after == pytest.approx(share * plain.whole.after)


def test_the_proof_compares_on_rows_held_back_alone() -> None:
    found = proved()
    assert found.as_given_rms_K == pytest.approx(3.0)
    assert (found.whole.before_rms_K, found.whole.after_rms_K) == pytest.approx((2.0, 0.5))
    assert found.whole.floor_rms_K == pytest.approx(np.sqrt((2 * 0.01 + 3 * 0.04) / 5))
    assert found.whole.form_K == pytest.approx(2 * found.whole.floor_rms_K)
    assert found.expected == pytest.approx(0.25)
    assert found.whole.before == pytest.approx((2 * (1 / 0.1) ** 2 + 3 * (1 / 0.2) ** 2) / 5)


def test_each_sensor_has_its_own_proof_and_one_without_rows_none() -> None:
    found = proved()
    assert list(found.per_sensor) == ["a", "b"]
    a, b = found.per_sensor.values()
    assert (a.before, b.before) == pytest.approx(((1 / 0.1) ** 2, (1 / 0.2) ** 2))
    assert (a.floor_rms_K, b.floor_rms_K) == pytest.approx((0.1, 0.2))
    assert replace(found, per_sensor={}).worse == ()
