"""The campaign's table as the figures that were asked for, with bounds and goals, in markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.discovery.judge import WRONG
from campaigns.resumable import Cells
from tests.truth.machine.effects import LADDERS

STRONG_SIGMA, FAIR_SIGMA = 4.0, 2.0
DETECTED = 0.9
"""An effect is detected at a strength from which on its right name comes in this part of the cases."""


@dataclass(frozen=True)
class Share:
    """So many of so many."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """The part, NaN of nothing."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def bounds(self) -> tuple[float, float]:
        """The exact 95 % bounds of the binomial's probability (Clopper & Pearson 1934)."""
        from scipy.stats import binomtest

        interval = binomtest(self.hits, self.of).proportion_ci(0.95, "exact")
        return float(interval.low), float(interval.high)

    def __str__(self) -> str:
        if not self.of:
            return "– | –"
        low, high = self.bounds
        return f"{self.hits}/{self.of} = {100 * self.value:.1f} % | {100 * low:.1f} … {100 * high:.1f} %"


@dataclass(frozen=True)
class Goal:
    """A figure, what it should be (`meets` nothing: there is no goal), and which share of the lines it is."""

    figure: str
    text: str
    meets: Callable[[float], bool] | None
    among: Callable[[Cells], bool]
    hit: Callable[[Cells], bool]

    def line(self, rows: Sequence[Cells]) -> str:
        """The figure's line of the table."""
        among = [row for row in rows if self.among(row)]
        share = Share(sum(map(self.hit, among)), len(among))
        met = "–" if self.meets is None else _met(self.meets(share.value), share.of)
        return f"| {self.figure} | {share} | {self.text} | {met} |"


def _met(met: bool, of: int) -> str:
    return ("yes" if met else "**no**") if of else "–"


def _sigma(row: Cells) -> float:
    return float(row["shows_sigma"])


def _of(*groups: str) -> Callable[[Cells], bool]:
    return lambda row: row["group"] in groups


def _between(low: float, high: float) -> Callable[[Cells], bool]:
    return lambda row: row["group"] == "ladder" and low <= _sigma(row) < high


def _is(*outcomes: str) -> Callable[[Cells], bool]:
    return lambda row: row["outcome"] in outcomes


def _good(row: Cells) -> bool:
    return row["good"] == "1"


def _at_least(bar: float) -> Callable[[float], bool]:
    return lambda value: value >= bar


def _at_most(bar: float) -> Callable[[float], bool]:
    return lambda value: value <= bar


_CLAIMS = (*WRONG, "partly")
GOALS: tuple[Goal, ...] = (
    Goal("null: wrongly named", "≤ 1 %", _at_most(0.01), _of("null"), _is(*_CLAIMS)),
    Goal("null: “unknown”", "≤ 3 %", _at_most(0.03), _of("null"), _is("unknown")),
    Goal("in the library: wrongly named", "≤ 1 %", _at_most(0.01), _of("ladder"), _is(*WRONG)),
    Goal("named rightly, ≥ 4 σ", "≥ 98 %", _at_least(0.98), _between(STRONG_SIGMA, np.inf), _is("right")),
    Goal(
        "named rightly, 2–4 σ", "≥ 90 %", _at_least(0.9), _between(FAIR_SIGMA, STRONG_SIGMA), _is("right")
    ),
    Goal(
        "… or in the set of doubts, 2–4 σ",
        "≥ 98 %",
        _at_least(0.98),
        _between(FAIR_SIGMA, STRONG_SIGMA),
        _is("right", "in_set"),
    ),
    Goal("outside the library: “unknown”", "≥ 95 %", _at_least(0.95), _of("outside"), _is("unknown")),
    Goal(
        "… and of these, sensor and phase right",
        "≥ 90 %",
        _at_least(0.9),
        lambda row: row["group"] == "outside" and row["outcome"] == "unknown",
        lambda row: row["localised"] == "1",
    ),
    Goal("two at once: both named", "≥ 90 %", _at_least(0.9), _of("pair"), _is("right")),
    Goal("true effect left out: another named", "0 %", _at_most(0.0), _of("absent"), _is(*_CLAIMS)),
    Goal("true effect left out: “unknown”", "–", None, _of("absent"), _is("unknown")),
    Goal("the same effect under two names: the doubt reported", "–", None, _of("ambiguous"), _good),
    Goal("poor cycle: no wrong claim", "–", None, _of("poor"), _good),
    Goal("faulty logs: right", "–", None, _of("faulty"), _good),
)  # fmt: skip


def _body(label: str) -> Callable[[Cells], bool]:
    return lambda row: row["group"] == "nut" and row["label"].startswith(label)


def _goals(
    group: str, name: str, hidden: str, none: tuple[str, Callable[[float], bool] | None]
) -> list[Goal]:
    """What is asked of the logs of a group, called by its name, in which nothing or an effect is hidden."""
    null, other = (
        lambda row: row["group"] == group and row["label"] == "null",
        lambda row: row["group"] == group and row["label"] != "null",
    )
    one_in_100 = ("≤ 1 %", _at_most(0.01))
    return [
        Goal(f"{name}, nothing hidden: wrongly named", *one_in_100, null, _is(*_CLAIMS)),
        Goal(f"{name}, nothing hidden: “none”", *none, null, _good),
        Goal(f"{name}, {hidden} hidden: wrongly named", *one_in_100, other, _is(*WRONG)),
        Goal(
            f"{name}, {hidden} hidden: right or in the set", "≥ 90 %", _at_least(0.9), other,
            _is("right", "in_set"),
        ),
    ]  # fmt: skip


TYPICAL_GOALS: tuple[Goal, ...] = tuple(
    goal for group in ("typical", "one log") for goal in _goals(group, group, "an effect", ("–", None))
)


ROUGH_GOALS: tuple[Goal, ...] = (
    Goal("a nut's body with heat of its own: named", "≥ 90 %", _at_least(0.9), _body("heated"), _is("right")),
    Goal("a nut's body without: named", "≥ 90 %", _at_least(0.9), _body("plain"), _is("right")),
    Goal("a nut's body: wrongly named", "≤ 1 %", _at_most(0.01), _of("nut"), _is(*WRONG)),
    Goal(
        "rough logs: wrongly named",
        "≤ 1 %",
        _at_most(0.01),
        _of("minutes", "gain", "torque", "air"),
        lambda row: row["outcome"] in WRONG or (row["label"] == "null" and row["outcome"] in _CLAIMS),
    ),
    *(
        goal
        for group, what in (
            ("minutes", "rows 1 min apart"),
            ("gain", "sensors 3 ± 2 % toward the air"),
            ("torque", "torque ±10 % from run to run"),
            ("air", "air ±6 K in some hours"),
        )
        for goal in _goals(group, what, "a loss", ("≥ 90 %", _at_least(0.9)))
        if "wrongly" not in goal.figure
    ),
)


def _housed(label: str | None) -> Callable[[Cells], bool]:
    return lambda row: (row["label"] == "null") == (label == "null")


HOUSED_GOALS: tuple[Goal, ...] = (
    Goal("nothing hidden: “none”", "100 %", _at_least(1.0), _housed("null"), _good),
    Goal("an effect hidden: wrongly named", "0", _at_most(0.0), _housed(None), _is(*WRONG)),
    Goal("… right, in the set, or “unknown”", "100 %", _at_least(1.0), _housed(None), _good),
    Goal("… right or in the set", "–", None, _housed(None), _is("right", "in_set")),
)


def housed_summary(rows: Sequence[Cells]) -> str:
    """The table of machines with sensors on nut and housings only."""
    lines = ["| figure | share | 95 % bounds | goal | met |", "|---|---|---|---|---|"]
    lines += [goal.line(rows) for goal in HOUSED_GOALS]
    return "\n".join(lines) + "\n"


def rough_summary(rows: Sequence[Cells]) -> str:
    """The table of real nuts and rough logs, and how well the parameters of bodies were found."""
    lines = ["| figure | share | 95 % bounds | goal | met |", "|---|---|---|---|---|"]
    lines += [goal.line(rows) for goal in ROUGH_GOALS]
    named = [row for row in rows if row["group"] == "nut" and row["outcome"] == "right"]
    lines += ["", "| parameter of a body named | cases | error, median / largest |", "|---|---|---|"]
    for key in ("capacity_J_K", "conductance_W_K", "heat_share", "loss_W_K"):
        cells = (cell for row in named for cell in row["errors"].split())
        error = [
            100 * abs(float(c.partition("=")[2])) for c in cells if c.startswith(f"attached_mass.{key}=")
        ]
        if error:
            lines.append(f"| `{key}` | {len(error)} | {np.median(error):.0f} % / {max(error):.0f} % |")
    return "\n".join(lines) + "\n"


def typical_summary(rows: Sequence[Cells]) -> str:
    """The table of the machines of typical users."""
    lines = ["| figure | share | 95 % bounds | goal | met |", "|---|---|---|---|---|"]
    lines += [goal.line(rows) for goal in TYPICAL_GOALS]
    return "\n".join(lines) + "\n"


def summary(rows: Sequence[Cells]) -> str:
    """The tables of a campaign."""
    figures = [
        "| figure | share | 95 % bounds | goal | met |",
        "|---|---|---|---|---|",
        *(goal.line(rows) for goal in GOALS),
    ]
    others = [
        "| figure | value | goal | met |",
        "|---|---|---|---|",
        *parameter_lines(rows),
        *proof_lines(rows),
        *time_lines(rows),
    ]
    limits = [
        "The least strength named rightly in 90 % of the cases:\n",
        *limit_lines(rows),
    ]
    return "\n\n".join("\n".join(part) for part in (figures, others, limits)) + "\n"


def parameter_lines(rows: Sequence[Cells]) -> list[str]:
    """Errors and coverage of the parameters of rightly named effects from 4 σ on, and of all."""
    lines = []
    for text, least in (("≥ 4 σ", STRONG_SIGMA), ("all", 0.0)):
        right = [r for r in rows if r["group"] == "ladder" and r["outcome"] == "right" and _sigma(r) >= least]
        error = 100 * np.abs(_values(right, "errors"))
        covered = _values(right, "covered")
        if not len(error):
            continue
        middle, high, cover = float(np.median(error)), float(np.quantile(error, 0.9)), 100 * covered.mean()
        met = _met(middle <= 3.0 and high <= 10.0, 1)
        lines += [
            f"| parameter error, {text}: median / p90 | {middle:.1f} % / {high:.1f} % | ≤ 3 % / 10 % |"
            f" {met} |",
            f"| 95 % intervals that hold the truth, {text} | {cover:.1f} % of {len(covered)} | 90–98 % |"
            f" {_met(90.0 <= cover <= 98.0, 1)} |",
        ]
    return lines


def _values(rows: Sequence[Cells], column: str) -> np.ndarray:
    cells = (cell for row in rows for cell in row[column].split())
    return np.array([float(cell.partition("=")[2]) for cell in cells])


def proof_lines(rows: Sequence[Cells]) -> list[str]:
    """How much of the gap goes, on data that took no part, where all that is hidden is named."""
    nulls = [float(r["before_K"]) for r in rows if r["group"] == "null" and r["before_K"]]
    right = [r for r in rows if r["group"] in ("ladder", "pair") and r["outcome"] == "right" and r["after_K"]]
    right = [r for r in right if _sigma(r) >= STRONG_SIGMA]
    if not nulls or not right:
        return []
    null_K = float(np.median(nulls))
    before, after = (np.array([float(r[key]) for r in right]) for key in ("before_K", "after_K"))
    ratio = float(np.median(after) / null_K)
    gone = np.median(1.0 - np.maximum(after**2 - null_K**2, 0.0) / np.maximum(before**2 - null_K**2, 1e-9))
    return [
        f"| proof residual after, ≥ 4 σ, over the nulls' (medians) | {ratio:.2f} | ≤ 1.2 |"
        f" {_met(ratio <= 1.2, 1)} |",
        f"| excess energy gone on the proof data (median) | {100 * gone:.1f} % | ≥ 90 % |"
        f" {_met(bool(gone >= 0.9), 1)} |",
    ]


def time_lines(rows: Sequence[Cells]) -> list[str]:
    """How long a search took, with another one on the other core."""
    took_s = [float(r["search_s"]) for r in rows if r["outcome"] != "failed"]
    if not took_s:
        return []
    middle, late, longest = np.quantile(took_s, (0.5, 0.95, 1.0))
    return [
        f"| seconds of a search, two at a time: median / p95 / longest | {middle:.1f} / {late:.1f} /"
        f" {longest:.1f} | ≤ 10 | {_met(bool(longest <= 10.0), 1)} |"
    ]


def limit_lines(rows: Sequence[Cells]) -> list[str]:
    """For each ladder: the least strength from which on the right name comes in 90 % of the cases."""
    lines = []
    for ladder in LADDERS:
        shares = [_rightly(rows, ladder.label, f"{strength:g}") for strength in ladder.strengths]
        if not any(share.of for share in shares):
            continue
        limit = detection_limit(ladder.strengths, shares)
        least = "not named" if limit is None else f"{limit:g}"
        lines.append(f"- `{ladder.label}`, {ladder.key}: {least}")
    return lines


def _rightly(rows: Sequence[Cells], label: str, strength: str) -> Share:
    own = [r for r in rows if (r["group"], r["label"], r["strength"]) == ("ladder", label, strength)]
    return Share(sum(r["outcome"] == "right" for r in own), len(own))


def detection_limit(strengths: Sequence[float], shares: Sequence[Share]) -> float | None:
    """The least strength from which on, at every greater one too, 90 % are named rightly; none: None."""
    limit = None
    for strength, share in zip(reversed(strengths), reversed(shares), strict=True):
        if not share.of or share.value < DETECTED:
            break
        limit = strength
    return limit
