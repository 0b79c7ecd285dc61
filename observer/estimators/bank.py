"""A bank of filters beside the estimate: what is left if a sensor is at fault, and the bound that follows.

Each filter takes all sensors but some: none of them left out, each alone, each pair, all; one more takes
them all, and their offsets walk, each and in common, as those of thermocouples and of a reference junction
drift. If sensor i is at fault, the filter without it is clean, whatever the fault: by how much the estimate
is off is then no more than how far the two are apart and what the clean one is uncertain by. The largest of
these over all faults that are to be reckoned with is the bound. Where tolerances are considered, the
estimate is more uncertain by what drifts make, and never less than some part of how far a clean one is away,
unless that one is as far as laws are wrong: where these are learnt, no sensor tells a heat from a fault.
Source: solution separation, Blanch et al. (2012), as satellite navigation has it; here the filters are those
of the screw. Which sensor is at fault is found in `fault_search`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.estimators import packing
from observer.estimators.answers import PREDICTIONS, SETTLED_S, SensorAnswers, answers_of, heat_response_K_W
from observer.estimators.fault_search import SearchResult, Seen, Trace, search
from observer.estimators.steps import StepCache
from observer.frames import BoolArray, FloatArray, Inputs
from observer.kernels import pour, record, run_bank
from observer.kernels.bank import DUE_S as DUE
from observer.kernels.bank import SPAN_S
from observer.kernels.codes import DEPARTED
from observer.kernels.layout import Bundle
from observer.kernels.screening import DECIDED_S, YOUNG_S
from observer.kernels.selftest import KNOWN
from observer.model.discretise import quantise
from observer.model.learning import Nuisance
from observer.model.plant import Plant
from observer.tables.estimator import Integrity

RISK_PER_H = 1e-5
"""What the widths of bounds are derived from; how often bounds failed was measured by the campaign."""
DUE_S = 5.0
"""How often the bank steps."""
_MOST_PAIRS = 28  # of eight sensors; with more, a second fault is found once the first is excluded
_TRUSTED = 1.5  # standard deviations that a clean filter may be away
_NEVER = 1e9  # as a gate: readings are judged by the estimate
_AFRESH = (
    "out_s", "agrees_s", "pending", "pending_s", "step_K", "mean_K", "samples", "unrest", "stepped_back",
)  # fmt: skip


class Gathered(NamedTuple):
    """What is gathered between two steps of the bank (see `observer.kernels.bank.gather`)."""

    span: FloatArray
    law_J: FloatArray
    jump_W2: FloatArray
    z_first: FloatArray
    z_last: FloatArray
    moving: NDArray[np.int64]
    weight: FloatArray
    B: FloatArray
    plain_B: FloatArray
    C: FloatArray
    y_degC: FloatArray
    seen: BoolArray
    free: BoolArray
    loss: FloatArray
    ahead: FloatArray
    ahead_degC: FloatArray


class Held(NamedTuple):
    """The bounds found last, of the heats and of the reported rows, what drifts add to the variances of both,
    what laws that have changed add to those of heats, and the limits of the rows. `known_sigma` (2,) are the
    standard deviations of field and error below which they are known, `grid` is the number of rows of the
    field, and `published` says whether these sensors give a bound, which is at least `sigmas` standard
    deviations.
    """

    heat_W: FloatArray
    field: FloatArray
    heat_drift_W2: FloatArray
    field_drift2: FloatArray
    law_change_W2: FloatArray
    limit: FloatArray
    known_sigma: FloatArray
    grid: int
    published: int
    sigmas: float


class BankFilters(NamedTuple):
    """The filters of a bank as the kernel takes them: which sensors each uses (F, s), their states, and their
    results after a step. `misfit` (F, s) and `S` (s, s) are filled as `kernels.bank.run_bank` says.
    """

    gathered: Any
    drifting: int
    filters: tuple[Any, ...]
    results: tuple[Any, ...]
    uses: NDArray[np.uint8]
    work: Any
    misfit: FloatArray
    S: FloatArray


@dataclass(frozen=True, slots=True)
class Design:
    """What a bank is made of: which sensors each filter uses (F, s), and which one lets offsets drift.

    `alone` (s,) are the filters without one sensor, `pair` (s, s) those without two, -1 where there is none;
    the last one has none. `sigmas` is how many standard deviations bound what no fault explains, `clean` the
    filters that are to be reckoned with as clean, and `fault_sigmas` (c, 1) theirs. `walk_K2_s` is what the
    variance of offsets that drift grows by in a second.
    """

    uses: NDArray[np.uint8]
    drifting: int
    alone: NDArray[np.int64]
    pair: NDArray[np.int64]
    sigmas: float
    clean: NDArray[np.int64]
    fault_sigmas: FloatArray
    walk_K2_s: float

    @classmethod
    def of(cls, thermal: BoolArray, settings: Integrity) -> Design:
        """The bank of sensors (s,), of which `thermal` are thermocouples.

        The others are used by every filter but the last: a probing cycle checks itself, and the bounds do not
        reckon with its faults.
        """
        sensors = len(thermal)
        pairs = list(combinations(range(sensors), 2)) if sensors * (sensors - 1) // 2 <= _MOST_PAIRS else []
        uses = np.ones((3 + sensors + len(pairs), sensors), np.uint8)
        uses[-1] = 0
        alone = 1 + np.arange(sensors)
        uses[alone, np.arange(sensors)] = 0
        pair = np.full((sensors, sensors), -1)
        for at, (i, j) in enumerate(pairs, 2 + sensors):
            uses[at, [i, j]] = 0
            pair[i, j] = pair[j, i] = at
        uses[:-1, ~thermal] = 1
        sigmas = [_sigmas(sensors * settings.fault_per_hour)] * sensors
        clean = alone
        if settings.common_fault_per_hour > RISK_PER_H:
            sigmas.append(_sigmas(settings.common_fault_per_hour))
            clean = np.append(alone, len(uses) - 1)
        return cls(
            uses, 1 + sensors, alone, pair, _sigmas(1.0), clean, np.array(sigmas)[:, None],
            settings.drift_K_sqrt_h**2 / 3600.0,
        )  # fmt: skip


def _sigmas(fault_per_hour: float) -> float:
    """How many standard deviations leave half of the risk to a fault that is so likely; 0 if it is rarer."""
    left = 0.5 * RISK_PER_H / max(fault_per_hour, 1e-300)
    return NormalDist().inv_cdf(1.0 - 0.5 * left) if left < 1.0 else 0.0


class Bank:
    """The filters on memory of their own; `gathered` and `held` are what the kernels fill and read."""

    def __init__(self, plant: Plant, settings: Integrity, plant_record: Any, steps: StepCache) -> None:
        """Allocate it for a plant."""
        self._steps = steps
        s, wide = plant.rows.sensors, len(plant.rows.C) - plant.rows.sensors
        self.design, self._thermal = Design.of(plant.thermal, settings), plant.thermal
        self._allows = plant.learnt > 0  # else the model is taken as exact, and no difference is trusted
        self._rests_on_laws = bool(np.any(plant.parameters.kind == Nuisance.LAW))
        initial = packing.initial_state(plant)
        F = len(self.design.uses)
        each = packing.thaw(initial)._asdict()
        stacked = {name: np.repeat(np.asarray(a)[None], F, axis=0) for name, a in each.items()}
        self._filters = Bundle.of(stacked)
        self._runnings = tuple(
            packing.Running._make(self._filters[name][f] for name in packing.Running._fields)
            for f in range(F)
        )
        self._octets: bytes | None = None
        self._own = Bundle.of(_between(plant))
        self.gathered = Gathered._make(self._own[name] for name in Gathered._fields)
        self.gathered_record = record(self.gathered)
        limit = np.full(wide, np.inf)
        g = plant.rows.grid
        limit[:g] = np.inf if settings.limit_K is None else settings.limit_K
        limit[g:] = np.inf if settings.limit_um is None else settings.limit_um
        remembered = [self._own[name] for name in Held._fields[: Held._fields.index("limit")]]
        known_sigma, publishes = KNOWN * _largest_prior(plant), not self._rests_on_laws
        self.held = Held._make([*remembered, limit, known_sigma, g, publishes, self.design.sigmas])
        self.held_record = record(self.held)
        self._results = packing.empty_results(plant, F)
        m, p, M = len(plant.B.T), len(plant.E.T), len(plant.moving)
        self._inputs = Inputs.empty(m, p, s, M, len(plant.decay_1_s), len(plant.rows.C))
        self._batch = record(packing.Batch(plant_record, None, self._inputs, np.zeros(1, np.int64), _NEVER))
        self._trace = Trace._make(self._own[name] for name in Trace._fields)
        self._answer_K = answers_of(np.sqrt(plant.noise_R_K2))
        # with sensors on the screw a heat is known well beside what a prediction moves
        self._response_K_W = np.zeros((1, s, int(plant.estimated.sum())))
        if self._rests_on_laws:
            self._response_K_W = heat_response_K_W(plant, DUE_S)
        self._answers = SensorAnswers._make(self._own[name] for name in SensorAnswers._fields)
        self._misfit, self._S = np.zeros((F, s)), np.zeros((s, s))
        self._filters_record = record(
            BankFilters(
                self.gathered_record, self.design.drifting, tuple(map(record, self._runnings)),
                tuple(record(packing.cut(self._results, slice(f, f + 1))) for f in range(F)),
                self.design.uses, packing.scratch(packing.pack_plant(plant)), self._misfit, self._S,
            )
        )  # fmt: skip

    @property
    def is_due(self) -> bool:
        """Whether so much has been gathered that the filters are to step."""
        return bool(self.gathered.span[SPAN_S] >= self.gathered.span[DUE])

    @property
    def octets(self) -> NDArray[np.uint8]:
        """Where it stands."""
        return np.concatenate([self._own.octets, self._filters.octets])

    def take(self, octets: NDArray[np.uint8]) -> None:
        """Stand where a bank stood; without anything, at the beginning."""
        own = len(self._own.octets)
        self._octets = None
        if len(octets) == own + len(self._filters.octets):
            self._own.octets[:], self._filters.octets[:] = octets[:own], octets[own:]

    def begin_at(self, x: FloatArray, P: FloatArray, around: FloatArray) -> None:
        """Have every filter stand at the same state."""
        self._octets = None
        self._answers.begin_again()
        for state in self._runnings:
            state.flags[0] = 1
            state.x[:], state.P[:, : len(P)], state.around[:] = x, P, around

    def keep(self) -> tuple[bytes, bytes]:
        """Return where it stands, to be put back; the filters are copied only after they stepped."""
        if self._octets is None:
            self._octets = self._filters.octets.tobytes()
        return self._own.octets.tobytes(), self._octets

    def put_back(self, kept: tuple[bytes, bytes]) -> None:
        """Stand where it stood."""
        self._own.put_back(kept[0])
        if self._octets is not kept[1]:
            self._filters.put_back(kept[1])
            self._octets = kept[1]

    def step(
        self, main: packing.Running, main_record: Any, results: packing.Results, k: int, time_s: float
    ) -> None:
        """Step every filter over what was gathered, hold the bounds, and act on what is found.

        `main` is the estimate's state after its step k, `results` that and what else it has found.
        """
        self._octets = None
        pour(self.gathered_record, main_record, self._batch.inputs)
        span_s = float(quantise(self._inputs.dt_s)[0])
        self._inputs.dt_s[0] = span_s
        self._batch.table = self._steps.table([span_s])
        run_bank(self._batch, self._filters_record, main_record, self.design.walk_K2_s * span_s)
        self._hold(results, k, float(main.verdict[0].age_s))
        if not self._runnings[-1].flags[0] and self._runnings[0].flags[0]:
            self._runnings[-1].flags[0] = 1  # by laws and air alone, from where all were at first
            _copy(self._runnings[0], self._runnings[-1])
        if self._allows:
            self._note_answers(main, span_s)
            self._act(main, span_s, time_s)

    def _hold(self, results: packing.Results, k: int, age_s: float) -> None:
        """Work out the bounds: over all filters that a fault leaves clean, the farthest they reach.

        Heats are compared from their laws, which the bank knows as means over its steps.
        """
        design, held, found = self.design, self.held, self._results
        heat_W = np.abs((results.heat[k] - results.law[k]) - (found.heat - found.law))
        field = np.abs(results.field[k] - found.field)
        for bound, apart, sigma in (
            (held.heat_W, heat_W, found.heat_sigma),
            (held.field, field, found.field_sigma),
        ):
            bound[:] = np.max(apart[design.clean] + design.fault_sigmas * sigma[design.clean], axis=0)
        if self._allows:
            held.heat_drift_W2[:] = self._drift(found.heat_sigma, 0.0)
            apart = found.field[design.drifting] - found.field[0]
            more = self._drift(found.field_sigma, apart)
            # before, filters without a sensor have yet to find the field; on laws alone they are always away
            if age_s >= YOUNG_S and not self._rests_on_laws:
                away = field[design.alone].max(axis=0) / _TRUSTED
                more = np.fmax(more, away**2 - found.field_sigma[0] ** 2)
            held.field_drift2[:] = np.fmax(more, 0.0)

    def _drift(self, sigma: FloatArray, apart: FloatArray | float) -> FloatArray:
        """What offsets that drift add to the variances of an estimate: by how much more the filter is
        uncertain that lets them, and how far it is `apart`; 0 where that is not known.
        """
        more = np.maximum(sigma[self.design.drifting] ** 2 - sigma[0] ** 2, 0.0) + np.square(apart)
        return np.asarray(np.nan_to_num(more, nan=0.0))

    def _note_answers(self, main: packing.Running, span_s: float) -> None:
        """Compare how readings move with predictions from earlier estimates, which run on without them."""
        answers, inputs, taken = self._answers, self._inputs, main.guard["cause"] == 0.0
        if main.verdict[0].age_s < SETTLED_S:
            answers.forget()
            return
        read_degC = inputs.y_degC[0] - main.verdict[0].common_K * self._thermal
        compared = ((self.gathered.free != 0) | ~taken) & self._thermal
        begun = answers.note(np.where(compared, read_degC, np.nan), self.gathered.ahead_degC)
        if begun >= 0:
            self.gathered.ahead[begun] = self._runnings[0].x
        answers.note_laws(self._results.law[0], self._results.heat_sigma[0], span_s)
        answers.judge(*self._answer_K, self._response_K_W)
        main.guard["agrees_s"][(answers.silent > 0.0) & ~taken] = 0.0  # not taken back before it answers

    def _act(self, main: packing.Running, span_s: float, time_s: float) -> None:
        """Look for a fault, and leave the sensor out that is found; what is ambiguous is not good."""
        each = self.design.alone, np.arange(len(main.guard))
        seen = Seen(
            float(main.verdict[0].age_s),
            main.guard["cause"] == 0.0,
            main.guard["cause"] == DEPARTED,
            self._thermal,
            self._misfit[each],
            np.where(self.design.pair >= 0, self._misfit[self.design.pair, each[1]], np.nan),
            self._results.innovation[0],
            self._S,
        )
        result = SearchResult(False, -1, 0)
        if main.verdict[0].latch == 0.0:
            result = search(seen, self._trace, self._answers, span_s)
        if result.doubted:
            main.verdict[0].hold_s = DECIDED_S
        if result.latch:
            main.verdict[0].latch, main.verdict[0].latched_s = result.latch, time_s
        if result.sensor >= 0:
            self._exclude(result.sensor, main, time_s)

    def _exclude(self, i: int, main: packing.Running, time_s: float) -> None:
        """Go on without sensor i, from the filter that never had it; every other one from its like."""
        design, guard = self.design, main.guard[i]
        guard.cause, guard.excess_K = DEPARTED, np.nan
        for name in _AFRESH:
            guard[name] = 0.0
        if guard.steps_out == 0.0:
            guard.first_out_s = time_s
        main.suspect[i] = main.refused_s[i] = main.opened_K[i] = 0.0
        self._answers.begin_again()
        clean = int(design.alone[i])
        _copy(self._runnings[clean], main)
        for j, without in enumerate(design.pair[i]):
            if without >= 0:
                _copy(self._runnings[without], self._runnings[design.alone[j]])
        for f in np.flatnonzero(design.uses[:, i]):
            if f not in design.alone:
                _copy(self._runnings[clean], self._runnings[f])


def _copy(source: packing.Running, into: packing.Running) -> None:
    """Take over field, heats and what is learnt."""
    for name in ("x", "P", "around"):
        getattr(into, name)[...] = getattr(source, name)


def _largest_prior(plant: Plant) -> FloatArray:
    """Return the largest σ of the field, K, and of the error, µm, before any reading; 0 without one."""
    rows = plant.rows.C[plant.rows.sensors :]
    sigma = np.sqrt(np.maximum(np.einsum("ra,ab,rb->r", rows, plant.prior_P, rows), 0.0))
    g = plant.rows.grid
    return np.array([sigma[:g].max(initial=0.0), sigma[g:].max(initial=0.0)])


def _between(plant: Plant) -> dict[str, Any]:
    """What is remembered beside the filters: what is gathered, the bounds last found, what has been seen."""
    m, p, M = len(plant.B.T), len(plant.E.T), len(plant.moving)
    n_x, s, R = len(plant.decay_1_s), plant.rows.sensors, len(plant.rows.C)
    m_e = int(plant.estimated.sum())
    moving = np.array([source.index for source in plant.moving], np.int64)
    gathered = Gathered(
        np.array([0.0, DUE_S, 0.0]), np.zeros(m), np.zeros(m), np.zeros(p), np.zeros(p), moving, np.zeros(M),
        np.zeros((M, n_x)), np.zeros((M, n_x)), np.zeros((M, R)), np.zeros(s), np.zeros(s, bool),
        np.zeros(s, bool), np.zeros(3),
        np.zeros((PREDICTIONS, n_x + m_e + plant.learnt)), np.zeros((PREDICTIONS, s)),
    )  # fmt: skip
    unknown = {
        "heat_W": np.full(m_e, np.nan), "field": np.full(R - s, np.nan),
        "heat_drift_W2": np.zeros(m_e), "field_drift2": np.zeros(R - s), "law_change_W2": np.zeros(m_e),
    }  # fmt: skip
    return gathered._asdict() | unknown | Trace.empty()._asdict() | SensorAnswers.empty(s, m_e)._asdict()
