"""What a search comes to and how it is proved: every bound from both sides, on results made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer.discovery import verdict
from observer.discovery.proof import Proof, SensorError, prove, proves
from observer.discovery.verdict import alternatives, decide, goodness
from observer.effects.sensing import SensorBias

ROWS = 1000
NOISE = 0.3
"""What noise alone makes of the mean squared whitened error."""
EPSILON = 1e-6
# The bounds in figures: a test that asked the code for them would follow it anywhere.
FORM, UNFIT, PROOF_UNFIT, WORSE, NOTICED = 0.01, 0.12, 0.3, 1.2, 0.4


def fit(mean_square: float, rows: int = ROWS) -> Any:
    """As much of a fit as a verdict looks at."""
    return SimpleNamespace(deviance=mean_square * rows, remainder=np.zeros(rows))


def trial(
    name: str, score: float, *, drop: float = 0.0, accepted: bool = True, mean_square: float = NOISE
) -> Any:
    return SimpleNamespace(
        candidate=SimpleNamespace(name=name, of=SensorBias),
        score=score,
        drop=drop,
        accepted=accepted,
        fit=fit(mean_square),
    )


def search(*rivals: tuple[Any, ...], null: float = 2.0, left: float = NOISE) -> Any:
    """A search whose winners lead their rivals; `left` is what its fit leaves."""
    return SimpleNamespace(
        null=fit(null), fit=fit(left), chosen=tuple(r[0] for r in rivals), rivals=tuple(rivals)
    )


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


@pytest.fixture(autouse=True)
def nothing_comes_down_to_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which effects are the same physics is tested elsewhere; here `same` are."""
    monkeypatch.setattr(
        verdict, "same_physics", lambda winner, rival: rival.candidate.name.startswith("same")
    )


def test_goodness_is_the_mean_of_what_is_used() -> None:
    assert goodness(fit(0.25)) == pytest.approx(0.25)
    assert goodness(SimpleNamespace(deviance=0.0, remainder=np.zeros(0))) == 0.0  # type: ignore[arg-type]


@pytest.mark.parametrize("over", [False, True])
@pytest.mark.parametrize("where", ["fitted", "held back"])
def test_what_is_left_beyond_noise_and_a_hundredth_of_what_was_explained_is_unknown(
    where: str, over: bool
) -> None:
    null, sign = 5.0, 1 if over else -1
    left = NOISE
    if where == "fitted":  # left = noise + UNFIT + FORM (null - left), solved for left
        left = (NOISE + UNFIT + FORM * null) / (1 + FORM) + sign * EPSILON
    bound = NOISE + PROOF_UNFIT + 2 * FORM * (null - left)
    after = bound + sign * EPSILON if where == "held back" else NOISE
    found = decide(search((trial("nut", 50.0),), null=null, left=left), proof(after), ())
    assert found.kind == ("unknown" if over else "named")
    if over:
        words = {"fitted": "in what was fitted", "held back": "on data held back"}[where]
        assert words in found.reason
        assert (found.sets, found.fits) == ((), ())
        assert found.fit.deviance == pytest.approx(left * ROWS)


def test_a_sensor_that_is_predicted_worse_is_unknown_even_if_all_together_are_better() -> None:
    worse = gap(NOISE, 2 * NOISE + NOTICED)
    found = decide(search((trial("nut", 50.0),)), proof(sensors=(worse,)), ())
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
    assert decide(search((trial("nut", 50.0),)), found, ()).kind == ("unknown" if grown else "named")


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
    two = search((trial("loss", 50.0),), (trial("body", 40.0),))
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
    found = decide(search((trial("a", 50.0),), (trial("b", 40.0),)), proof(), ("the log is short",))
    assert found.kind == "named"
    assert found.reason == "missing: a and b"
    assert [[c.name for c in each] for each in found.sets] == [["a", "b"]]


def sets(found: Any, noise: float = NOISE) -> list[str]:
    exchanged, fits = alternatives(found, noise)
    assert len(exchanged) == len(fits)
    assert fits[0] is found.fit
    return [" ".join(c.name for c in each) for each in exchanged]


@pytest.mark.parametrize(
    ("drop", "left", "reach"),
    [
        (100.0, NOISE, 9.0),  # 2 % of the drop is less than nine
        (3000.0, NOISE, 9.0),  # 2 % of the drop is 60, but nothing is left unexplained
        (3000.0, NOISE + 0.01, 40.0),  # four times the 10 left unexplained
        (3000.0, NOISE + 0.1, 60.0),
        (3000.0, NOISE - 0.1, 9.0),  # less than noise is as good as noise
    ],
)
def test_a_rival_within_reach_cannot_be_distinguished_from_the_winner(
    drop: float, left: float, reach: float
) -> None:
    near, far = trial("near", 100.0 - reach + EPSILON), trial("far", 100.0 - reach - EPSILON)
    winner = trial("winner", 100.0, drop=drop)
    found = search((winner, near, far), left=left)
    assert sets(found) == ["winner", "near"]
    assert alternatives(found, NOISE)[1][1] is near.fit


def test_a_rival_exactly_nine_behind_the_winner_is_an_alternative() -> None:
    assert sets(search((trial("winner", 100.0), trial("near", 91.0)))) == ["winner", "near"]


def test_a_rival_that_was_not_accepted_or_is_the_same_physics_is_none() -> None:
    refused = trial("refused", 100.0, accepted=False)
    assert sets(search((trial("winner", 100.0), refused, trial("same", 100.0)))) == ["winner"]


def test_one_effect_is_exchanged_in_its_own_place() -> None:
    first = (trial("a", 100.0), trial("x", 99.0))
    second = (trial("b", 50.0), trial("y", 49.0), trial("z", 48.0))
    found = search(first, second)
    assert sets(found) == ["a b", "x b", "a y", "a z"]
    said = decide(found, proof(), ())
    assert said.kind == "ambiguous"
    assert said.reason == "these logs cannot distinguish a and b from x and b from a and y from a and z"
    assert said.fits[0] is said.fit is found.fit


# ---- the proof ----

MEASURED_K = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
PROOF_ROWS = np.array([True, False, True, True, True, False, True])
SENSOR = np.array([0, 0, 0, 1, 1, 1, 1])
NOISE_K = np.array([0.1, 9.0, 0.1, 0.2, 0.2, 9.0, 0.2])


def proved(less_K: float | None = None) -> Proof:
    """The proof of a fit that predicts 0.5 K too little, where the calibrated model errs by 2 K; `less_K`: by
    how much one of fewer effects does. Of each, the tolerances explain a tenth.
    """
    evidence = SimpleNamespace(
        proof=PROOF_ROWS, sensor=SENSOR, noise_K=NOISE_K, measured_degC=MEASURED_K, expected=NOISE,
        whitened=lambda error_K: error_K / NOISE_K, deviation_K=2 * NOISE_K,
    )  # fmt: skip
    off_K = {"given": 3.0, "null": -2.0, "fit": 0.5, "less": less_K or 0.0}
    config = SimpleNamespace(name="given", sensor=[SimpleNamespace(name=n) for n in ("t1", "t2", "unseen")])
    problem = SimpleNamespace(
        evidence=evidence, config=config, error_K=lambda c: np.full(len(SENSOR), off_K[c.name])
    )

    def of(name: str, factor: float) -> Any:
        marginal = lambda rows: lambda values: factor * values  # noqa: E731
        return SimpleNamespace(
            problem=problem,
            config=SimpleNamespace(name=name),
            marginal=marginal,
            within_tolerances_K=lambda _named: np.full(len(SENSOR), 0.1 * off_K[name]),
            stretch=lambda _named: 8.2,
        )

    less = () if less_K is None else (("body", of("less", 0.1)),)
    return prove(of("null", 1.0), of("fit", 0.1), less)


@pytest.mark.parametrize(("less_K", "unproved"), [(0.12, True), (0.62, True), (-0.62, True), (0.63, False)])
def test_an_effect_is_unproved_where_the_others_alone_leave_as_little(
    less_K: float, *, unproved: bool
) -> None:
    """With it 0.45 K are beyond tolerances; nine tenths of 0.625 K are a quarter more."""
    found = proved(less_K)
    assert found.whole.form_K == pytest.approx(2 * found.whole.floor_rms_K)
    assert found.unproved == (("body",) if unproved else ())
    assert found.stretch == (8.2 if unproved else 0.0)


def test_what_tolerances_explain_is_taken_off_the_gap() -> None:
    found = proved()
    assert found.whole.beyond_tolerances_K == pytest.approx((1.8, 0.45))
    assert all(each.beyond_tolerances_K == pytest.approx((1.8, 0.45)) for each in found.per_sensor.values())


def test_the_proof_compares_on_rows_held_back_alone() -> None:
    found = proved()
    assert found.as_given_rms_K == pytest.approx(3.0)
    assert (found.whole.before_rms_K, found.whole.after_rms_K) == pytest.approx((2.0, 0.5))
    assert found.whole.floor_rms_K == pytest.approx(np.sqrt((2 * 0.01 + 3 * 0.04) / 5))
    assert found.expected == NOISE


def test_the_proof_is_whitened_and_marginalised_by_each_fit_itself() -> None:
    found = proved()
    first, second = 2 / 0.1, 2 / 0.2
    assert found.whole.before == pytest.approx((2 * first**2 + 3 * second**2) / 5)
    assert found.whole.after == pytest.approx(found.whole.before * (0.1 * 0.5 / 2) ** 2)


def test_each_sensor_has_its_own_proof_and_one_without_rows_none() -> None:
    found = proved()
    assert list(found.per_sensor) == ["t1", "t2"]
    t1, t2 = found.per_sensor.values()
    assert (t1.before, t2.before) == pytest.approx(((2 / 0.1) ** 2, (2 / 0.2) ** 2))
    assert (t1.floor_rms_K, t2.floor_rms_K) == pytest.approx((0.1, 0.2))
    assert replace(found, per_sensor={}).worse == ()
