"""A bank of filters that use fewer sensors than the estimate, and the bounds that follow from them.

The filters use all sensors, all but each one, all but each pair, and none. In one more filter with all
sensors, each offset drifts, and so does a common one, like thermocouples and their reference junction.

If sensor i is at fault, the filter without it is unaffected. The error of the estimate is then at most the
distance between the two plus the uncertainty of the unaffected filter. The bound is the largest such sum over
all faults in `[integrity]`. Where tolerances are considered, drifts add to the variance of the estimate. Its
σ is then at least a fixed share of the distance to each unaffected filter. The share does not apply where
laws are learnt, because sensors then cannot distinguish a heat from a fault. Source: solution separation as
in satellite navigation, Blanch et al. (2012). `fault_search` finds the sensor at fault.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.config.estimator import Integrity
from observer.estimators import packing
from observer.estimators.answers import PREDICTIONS, SETTLED_S, SensorAnswers, answers_of, heat_response_K_W
from observer.estimators.fault_search import BankObservation, SearchResult, Trace, search
from observer.estimators.steps import StepCache
from observer.frames import BoolArray, FloatArray, Inputs
from observer.kernels import pour, record, run_bank
from observer.kernels.bank import DUE_S as DUE
from observer.kernels.bank import SPAN_S
from observer.kernels.codes import DEPARTED
from observer.kernels.layout import Bundle
from observer.kernels.screening import DECIDED_S, YOUNG_S
from observer.kernels.selftest import KNOWN_SHARE
from observer.model.discretise import quantise
from observer.model.learning import Nuisance
from observer.model.plant import Plant

RISK_PER_H = 1e-5
"""Design risk of the half-widths of bounds; a campaign measured the failure rate."""
DUE_S = 5.0
"""How often the bank steps."""
_MOST_PAIRS = 28  # of eight sensors; with more, a second fault is found once the first is excluded
_TRUSTED = 1.5  # standard deviations that a clean filter may be away
_NEVER = 1e9  # as a gate: readings are judged by the estimate
_AFRESH = (
    "out_s", "agrees_s", "pending", "pending_s", "step_K", "mean_K", "samples", "unrest", "stepped_back",
)  # fmt: skip


class Gathered(NamedTuple):
    """Inputs and readings summed between two steps of the bank (see `observer.kernels.bank.gather`).

    With m sources, p known inputs, M moving nuts, s sensors, R output rows and w predictions. The kernel
    resets the sums when the bank steps.

    Attributes:
        span: Length of the span, s, the length at which the bank is due, s, and the worst degradation of an
            input, (3,).
        law_J: Energy by each law over the span, J, (m,).
        jump_W2: Sum of the squared jumps of each law, W², (m,).
        z_first: Known inputs at the beginning of the span, (p,).
        z_last: Known inputs at its end, (p,).
        moving: Source of each moving nut, (M,).
        weight: Energy of each moving nut, J, by which its columns are averaged, (M,).
        B: Input columns of nuts times their energy, (M, n_x).
        plain_B: Input columns of nuts times time, used while a nut makes no heat, (M, n_x).
        C: Last output columns of nuts, (M, R).
        y_degC: Last usable readings, °C, or µm of a displacement, (s,).
        fresh: True for sensors with a reading within the span, (s,).
        free: True for sensors with a reading that the estimate does not doubt, (s,).
        loss: The rate of a uniform loss summed over time, 1, its sum weighted by the temperature it draws to,
            °C, and the last such temperature, °C, (3,).
        ahead: States of the predictions that run on without readings, (w, n).
        ahead_degC: Readings that they predict, °C, (w, s).
    """

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
    fresh: BoolArray
    free: BoolArray
    loss: FloatArray
    ahead: FloatArray
    ahead_degC: FloatArray


class BankBounds(NamedTuple):
    """The last bounds of heats and reported rows, with the limits of the rows.

    With m_e heats and r reported rows. Rows are the g rows of the field, K, then those of the thermal error,
    µm.

    Attributes:
        heat_W: Bounds of the heats, W, (m_e,), NaN before the bank's first step.
        field: Bounds of the reported rows, (r,), NaN before the bank's first step.
        heat_drift_W2: Variance of heats by drifting offsets, W², (m_e,).
        field_drift2: Variance of the rows by drifting offsets, K² or µm², (r,).
        law_change_W2: Variance of heats by changed laws, W², (m_e,).
        limit: Largest bounds of a good estimate, (r,), infinite without a limit.
        known_sigma: σ below which field, K, and error, µm, count as known, (2,).
        grid: Number g of rows of the field.
        published: 1 if these sensors give a useful bound, 0 where heats rest on their laws.
        sigmas: Standard deviations that a bound has at least.
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
    """The filters of a bank as records for the kernel: their states, and their results after a step.

    `uses` (F, s) marks the sensors of each filter. `kernels.bank.run_bank` fills `misfit` (F, s) and `S`
    (s, s).

    Attributes:
        gathered: Record of `Gathered`, the inputs of the step.
        drifting: Number of the filter whose offsets drift.
        filters: Records of the states of the F filters.
        results: Records of their results of one step.
        uses: 1 where a filter uses a sensor, (F, s).
        work: Scratch memory that all filters share (`packing.Work`).
        misfit: Distance of each reading from the prediction of a filter that does not use it, in σ, (F, s).
            It is 0 where the filter uses the sensor.
        S: Covariance of the innovations of the filter with all sensors, K², (s, s).
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
    """The composition of a bank of F filters over s sensors.

    Attributes:
        uses: 1 where a filter uses a sensor, (F, s). Filter 0 uses all, the last one none.
        drifting: Number of the filter in which offsets and their common part drift.
        without_one: Filter without each sensor, (s,).
        without_two: Filter without each pair, (s, s), -1 where the bank has no such filter.
        sigmas: Half-width of a bound without a fault, in σ.
        clean: Filters that a fault in `[integrity]` leaves unaffected, (c,).
        fault_sigmas: Half-widths of the bounds about them, in σ, (c, 1).
        walk_K2_s: Growth of the variance of a drifting offset, K²/s.
    """

    uses: NDArray[np.uint8]
    drifting: int
    without_one: NDArray[np.int64]
    without_two: NDArray[np.int64]
    sigmas: float
    clean: NDArray[np.int64]
    fault_sigmas: FloatArray
    walk_K2_s: float

    @classmethod
    def of(cls, thermal: BoolArray, settings: Integrity) -> Design:
        """Return the composition for the sensors of a plant.

        Every filter but the last uses the sensors of displacement. A probing cycle checks itself, so the
        bounds do not cover its faults. Beyond eight sensors the bank has no filters without pairs. A second
        fault is then found once the first sensor is excluded.

        Args:
            thermal: True for thermocouples, (s,).
            settings: The table `[integrity]`. The half-width for one sensor leaves half of `RISK_PER_H` to
                its fault. A common fault is covered if its rate is above `RISK_PER_H`.
        """
        sensors = len(thermal)
        pairs = list(combinations(range(sensors), 2)) if sensors * (sensors - 1) // 2 <= _MOST_PAIRS else []
        uses = np.ones((3 + sensors + len(pairs), sensors), np.uint8)
        uses[-1] = 0
        without_one = 1 + np.arange(sensors)
        uses[without_one, np.arange(sensors)] = 0
        without_two = np.full((sensors, sensors), -1)
        for at, (i, j) in enumerate(pairs, 2 + sensors):
            uses[at, [i, j]] = 0
            without_two[i, j] = without_two[j, i] = at
        uses[:-1, ~thermal] = 1
        sigmas = [_sigmas(sensors * settings.fault_per_hour)] * sensors
        clean = without_one
        if settings.common_fault_per_hour > RISK_PER_H:
            sigmas.append(_sigmas(settings.common_fault_per_hour))
            clean = np.append(without_one, len(uses) - 1)
        return cls(
            uses, 1 + sensors, without_one, without_two, _sigmas(1.0), clean, np.array(sigmas)[:, None],
            settings.drift_K_sqrt_h**2 / 3600.0,
        )  # fmt: skip


def _sigmas(fault_per_hour: float) -> float:
    """Return the standard deviations that leave half of the risk to such a fault; 0 if it is rarer."""
    left = 0.5 * RISK_PER_H / max(fault_per_hour, 1e-300)
    return NormalDist().inv_cdf(1.0 - 0.5 * left) if left < 1.0 else 0.0


class Bank:
    """The filters of a bank on their own memory, which kernels read and change.

    Attributes:
        design: The composition of the bank.
        gathered: Inputs since the last step. The kernel of the estimate adds to them.
        gathered_record: The same as a record.
        bounds: The last bounds, which the kernel adds to the estimate.
        bounds_record: The same as a record.
    """

    def __init__(self, plant: Plant, settings: Integrity, plant_record: Any, steps: StepCache) -> None:
        """Allocate the filters before their first reading.

        Args:
            plant: The model. With uncertain parameters, faults are searched and drifts enlarge σ; without
                them, only bounds are computed.
            settings: The table `[integrity]`.
            plant_record: The same plant as a record for kernels.
            steps: Cache of step matrices with a last table of its own.
        """
        self._steps = steps
        s, wide = plant.rows.sensors, len(plant.rows.C) - plant.rows.sensors
        self.design, self._thermal = Design.of(plant.thermal, settings), plant.thermal
        self._allows = plant.learnt > 0  # else the model is taken as exact, and no difference is trusted
        self._rests_on_laws = bool(np.any(plant.parameters.kind == Nuisance.LAW))
        initial = packing.initial_state(plant)
        F = len(self.design.uses)
        arrays = packing.thaw(initial)._asdict()
        stacked = {name: np.repeat(np.asarray(a)[None], F, axis=0) for name, a in arrays.items()}
        self._filters = Bundle.of(stacked)
        self._runnings = tuple(
            packing.Running._make(self._filters[name][f] for name in packing.Running._fields)
            for f in range(F)
        )
        self._own = Bundle.of(_between(plant))
        self.gathered = Gathered._make(self._own[name] for name in Gathered._fields)
        self.gathered_record = record(self.gathered)
        limit = np.full(wide, np.inf)
        g = plant.rows.grid
        limit[:g] = np.inf if settings.limit_K is None else settings.limit_K
        limit[g:] = np.inf if settings.limit_um is None else settings.limit_um
        remembered = [self._own[name] for name in BankBounds._fields[: BankBounds._fields.index("limit")]]
        known_sigma, publishes = KNOWN_SHARE * _largest_prior(plant), not self._rests_on_laws
        self.bounds = BankBounds._make([*remembered, limit, known_sigma, g, publishes, self.design.sigmas])
        self.bounds_record = record(self.bounds)
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
        """Whether the gathered inputs cover `DUE_S`, so that `step` must be called."""
        return bool(self.gathered.span[SPAN_S] >= self.gathered.span[DUE])

    @property
    def octets(self) -> NDArray[np.uint8]:
        """The state of the bank as bytes, a copy: sums, bounds and search, then the filters."""
        return np.concatenate([self._own.octets, self._filters.octets])

    def take(self, octets: NDArray[np.uint8]) -> None:
        """Restore the state of a bank from `octets`.

        Bytes of another size are ignored and the state stays. They come from another model or from an
        estimator without a bank.
        """
        own_size = len(self._own.octets)
        if len(octets) == own_size + len(self._filters.octets):
            self._own.octets[:], self._filters.octets[:] = octets[:own_size], octets[own_size:]

    def begin_at(self, x: FloatArray, P: FloatArray, linearisation_point: FloatArray) -> None:
        """Set every filter to the same state, and start all predictions again.

        Args:
            x: State of field, heats and parameters, (n,).
            P: Its covariance, (n, n).
            linearisation_point: As in `EstimatorState.around`.
        """
        self._answers.begin_again()
        for state in self._runnings:
            state.flags[0] = 1
            state.x[:], state.P[:, : len(P)], state.around[:] = x, P, linearisation_point

    def step(
        self, main: packing.Running, main_record: Any, results: packing.Results, k: int, time_s: float
    ) -> None:
        """Step every filter over the gathered inputs, update the bounds, and exclude a sensor at fault.

        An excluded sensor is marked in `main.guard`. The estimate then continues from the filter that does
        not use that sensor.

        Args:
            main: State of the estimate after its step k, changed in place.
            main_record: The same as a record.
            results: Results of the estimate. Heats and rows of step k are compared with those of the filters.
            k: The step, an index into `results`.
            time_s: Time of the step, s.
        """
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
        """Compute the bounds: the largest reach over all filters that a fault leaves unaffected.

        Heats are compared as deviations from their laws, which the bank averages over its steps.
        """
        design, bounds, filtered = self.design, self.bounds, self._results
        heat_W = np.abs((results.heat[k] - results.law[k]) - (filtered.heat - filtered.law))
        field = np.abs(results.field[k] - filtered.field)
        for bound, apart, sigma in (
            (bounds.heat_W, heat_W, filtered.heat_sigma),
            (bounds.field, field, filtered.field_sigma),
        ):
            bound[:] = np.max(apart[design.clean] + design.fault_sigmas * sigma[design.clean], axis=0)
        if self._allows:
            bounds.heat_drift_W2[:] = self._drift(filtered.heat_sigma, 0.0)
            apart = filtered.field[design.drifting] - filtered.field[0]
            extra_variance = self._drift(filtered.field_sigma, apart)
            # before, filters without a sensor have not settled; with laws alone they always differ
            if age_s >= YOUNG_S and not self._rests_on_laws:
                away = field[design.without_one].max(axis=0) / _TRUSTED
                extra_variance = np.fmax(extra_variance, away**2 - filtered.field_sigma[0] ** 2)
            bounds.field_drift2[:] = np.fmax(extra_variance, 0.0)

    def _drift(self, sigma: FloatArray, apart: FloatArray | float) -> FloatArray:
        """Return the variance that drifting offsets add to an estimate; 0 where it is unknown.

        It is the extra variance of the filter with drifting offsets plus the square of its distance `apart`.
        """
        extra_variance = np.maximum(sigma[self.design.drifting] ** 2 - sigma[0] ** 2, 0.0) + np.square(apart)
        return np.asarray(np.nan_to_num(extra_variance, nan=0.0))

    def _note_answers(self, main: packing.Running, span_s: float) -> None:
        """Compare the movement of readings with that of predictions from earlier estimates."""
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
        """Search for a fault and exclude the sensor at fault; an ambiguous fault lowers the quality."""
        own_filter = self.design.without_one, np.arange(len(main.guard))
        observation = BankObservation(
            float(main.verdict[0].age_s),
            main.guard["cause"] == 0.0,
            main.guard["cause"] == DEPARTED,
            self._thermal,
            self._misfit[own_filter],
            np.where(
                self.design.without_two >= 0, self._misfit[self.design.without_two, own_filter[1]], np.nan
            ),
            self._results.innovation[0],
            self._S,
        )
        result = SearchResult(False, -1, 0)
        if main.verdict[0].latch == 0.0:
            result = search(observation, self._trace, self._answers, span_s)
        if result.doubted:
            main.verdict[0].hold_s = DECIDED_S
        if result.latch:
            main.verdict[0].latch, main.verdict[0].latched_s = result.latch, time_s
        if result.sensor >= 0:
            self._exclude(result.sensor, main, time_s)

    def _exclude(self, i: int, main: packing.Running, time_s: float) -> None:
        """Exclude sensor i: continue each filter from the one that does not use it either."""
        design, guard = self.design, main.guard[i]
        guard.cause, guard.excess_K = DEPARTED, np.nan
        for name in _AFRESH:
            guard[name] = 0.0
        if guard.steps_out == 0.0:
            guard.first_out_s = time_s
        main.suspect[i] = main.refused_s[i] = main.opened_K[i] = 0.0
        self._answers.begin_again()
        clean = int(design.without_one[i])
        _copy(self._runnings[clean], main)
        for j, without in enumerate(design.without_two[i]):
            if without >= 0:
                _copy(self._runnings[without], self._runnings[design.without_one[j]])
        for f in np.flatnonzero(design.uses[:, i]):
            if f not in design.without_one:
                _copy(self._runnings[clean], self._runnings[f])


def _copy(source: packing.Running, into: packing.Running) -> None:
    """Copy field, heats and learnt parameters."""
    for name in ("x", "P", "around"):
        getattr(into, name)[...] = getattr(source, name)


def _largest_prior(plant: Plant) -> FloatArray:
    """Return the largest σ of the field, K, and of the error, µm, before any reading; 0 without one."""
    rows = plant.rows.C[plant.rows.sensors :]
    sigma = np.sqrt(np.maximum(np.einsum("ra,ab,rb->r", rows, plant.prior_P, rows), 0.0))
    g = plant.rows.grid
    return np.array([sigma[:g].max(initial=0.0), sigma[g:].max(initial=0.0)])


def _between(plant: Plant) -> dict[str, Any]:
    """Return the arrays a bank keeps between steps: gathered inputs, bounds, trace and answers."""
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
