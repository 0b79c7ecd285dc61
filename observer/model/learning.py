"""What of a machine is only roughly known, as states beside its heats: learnt while it runs, or considered.

Each is a small change θ of the configuration, and what it does is linear in θ:

    dx/dt = … + c θ,  c = A x + B q + E z + f,        y_i = … + (C x + F z + d) θ.

Live filters, fixed gains, predictions within tolerances and `check` all take these arrays. All wander as
first-order Markov processes about nothing, in a day, so that none is ever known exactly. What is
considered only (Schmidt 1966) keeps its value while its covariances are carried.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from observer.frames import FloatArray
from observer.tables.estimator import Learnable

WANDER_S = 86_400.0
"""In what time a parameter becomes another one, as films, clamps and laws do from day to day."""
REST_K = 0.1
"""How far a screw is from one temperature, and that from the air's, after a night."""


class Nuisance(IntEnum):
    """What a state is of: the machine, or one of its sensors; in the order of `Learnable`."""

    CONVECTION = 0
    CONDUCTIVITY = 1
    HEAT_CAPACITY = 2
    AMBIENT = 3
    END = 4
    LAW = 5
    OFFSET = 6
    PLACE = 7
    LAG = 8
    LINK = 9
    CAPACITY = 10
    GAIN = 11
    DIVISION = 12

    @property
    def key(self) -> str:
        """What `[tolerance]` and `[estimator] learn` call it."""
        return str(get_args(Learnable)[self])

    @property
    def of_a_sensor(self) -> bool:
        """Whether it is one of the sensors', and not of the machine."""
        return self in (Nuisance.OFFSET, Nuisance.PLACE, Nuisance.LAG, Nuisance.GAIN)


class Change(NamedTuple):
    """What one unit of a parameter does, on a plant of n_x states with p known inputs.

    To dx/dt: A is `rate_1_s` (n_x,) on the diagonal, and `into` (n_x,) times the row `seen` (n_x,) beside it,
    for a link to a nut that moves with the nut over its stroke; filters take the nut where it is, by the
    number of this link among those of the plant's coupling, `tie`, none for -1;
    B q is `heats` (n_x,) times what all heats do, and what the law of source `law` does, none for -1; where
    the heat of source `divided` enters `into` instead of where it does, none for -1, q (`into` − B); E is
    `known` (p, n_x), and f `steady` (n_x,). To the reading of sensor `of`: the row C, `row` (n_x,), the row
    F, `row_known` (p,), and d, `shift_K`; a lag makes of a reading what it was `lag_s` before.
    """

    rate_1_s: FloatArray
    into: FloatArray
    seen: FloatArray
    heats: FloatArray
    law: int
    divided: int
    tie: int
    known: FloatArray
    steady: FloatArray
    row: FloatArray
    row_known: FloatArray
    shift_K: float
    lag_s: float


class Parameter(NamedTuple):
    """One parameter: its `kind`, and of which end, estimated heat or sensor it is; `sigma` its prior, in the
    unit of its state: relative to its value, or in K, W/K, m, s; what a unit of it does; and, where it is
    learnt, what it is called, and the `value` and `unit` in which it is reported: value + unit · state.
    """

    kind: Nuisance
    of: int
    sigma: float
    change: Change
    name: str = ""
    value: float = 0.0
    unit: float = 1.0


class LearningArrays(NamedTuple):
    """What kernels need of L such states, the t of the machine before those of sensors; no state where L = 0.

    `kind`, `of`, `sigma` (L,) as in `Parameter`; `held` (h,) which are considered only; then what each does,
    as in `Change`, (L, …), and `heated` (L,), whether it has a part in what heats do. `ambient` is the column
    of z; `rest_P` (n_x, n_x), K², how far a screw is from the air's temperature after a night, where `rests`
    is 1. What those of the machine do is described on the states x = `V` ξ of a plant in another basis, with
    `inverse`; both are empty where ξ is x.
    """

    machine: int
    kind: NDArray[np.int64]
    of: NDArray[np.int64]
    sigma: FloatArray
    held: NDArray[np.int64]
    rate_1_s: FloatArray
    into: FloatArray
    seen: FloatArray
    heats: FloatArray
    law: NDArray[np.int64]
    divided: NDArray[np.int64]
    tie: NDArray[np.int64]
    known: FloatArray
    steady: FloatArray
    row: FloatArray
    row_known: FloatArray
    shift_K: FloatArray
    lag_s: FloatArray
    heated: NDArray[np.int64]
    ambient: int
    rests: int
    rest_P: FloatArray
    V: FloatArray
    inverse: FloatArray

    def drives(
        self, x: FloatArray, B: FloatArray, law_W: FloatArray, heat_W: FloatArray, z: FloatArray
    ) -> FloatArray:
        """Return c (n_x, L) at a state x (n_x,), with input columns B (n_x, m), the heats by their laws and
        as they are (m,), and known inputs z (p,).
        """
        turned = len(self.V) > 0
        if turned:
            x, B = self.V @ x, self.V @ B
        tied, driven = self.seen @ x, B @ heat_W
        c = self.rate_1_s * x + self.into * tied[:, None] + self.heats * driven
        c += np.einsum("ipa,p->ia", self.known, z) + self.steady
        by_law = self.law >= 0
        c[by_law] += (B * law_W).T[self.law[by_law]]
        for i in np.flatnonzero(self.divided >= 0):
            source = self.divided[i]
            c[i] += (self.into[i] - B[:, source]) * heat_W[source]
        return np.asarray(self.inverse @ c.T if turned else c.T)

    def feedback(self, theta: FloatArray) -> FloatArray:
        """Return ∂(c θ)/∂x (n_x, n_x) at parameters θ (L,)."""
        A = np.diag(theta @ self.rate_1_s) + (self.into.T * theta) @ self.seen
        return self.inverse @ A @ self.V if len(self.V) else A

    def in_basis(self, V: FloatArray, inverse: FloatArray) -> LearningArrays:
        """Return the same for the states ξ, x = V ξ (n_x, n_x), of a plant that has others than these."""
        row = self.row @ V
        if len(self.V):
            V, inverse = self.V @ V, inverse @ self.inverse
        return self._replace(V=V, inverse=inverse, row=row)

    def described_on(self, V: FloatArray, inverse: FloatArray) -> LearningArrays:
        """Return the same, described on the states V x (n_x, n_x) of a plant whose x these are; what acts on
        each state by itself, `rate_1_s` and `heats`, is taken as described on V x already.
        """
        return self._replace(
            into=self.into @ V.T,
            seen=self.seen @ inverse,
            known=self.known @ V.T,
            steady=self.steady @ V.T,
            V=V,
            inverse=inverse,
        )

    def entries(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """Return C x + F z + d (L,) at a state and known inputs (p,); lags do not follow from these alone,
        and are 0 here.
        """
        return np.asarray(self.row @ x + self.row_known @ z + self.shift_K)


_PER_PARAMETER = ("kind", "of", "sigma", "heated", *Change._fields)


def of_parameters(arrays: LearningArrays, selected: NDArray[np.int64]) -> LearningArrays:
    """Return the arrays of some parameters (r,) in that order, those of the machine first; all learnt."""
    fields = {name: getattr(arrays, name)[selected] for name in _PER_PARAMETER}
    machine = int((selected < arrays.machine).sum())
    return arrays._replace(machine=machine, held=np.zeros(0, np.int64), **fields)


def joined(arrays: LearningArrays, added: LearningArrays) -> LearningArrays:
    """Return the arrays with more parameters behind them."""
    fields: dict[str, Any] = {
        name: np.concatenate([getattr(arrays, name), getattr(added, name)]) for name in _PER_PARAMETER
    }
    return arrays._replace(**fields)


@dataclass(frozen=True, slots=True)
class Learning:
    """The states, and what the learnt ones are called: `names` (l,), which `states` (l,) they are, and the
    `value` (l,) and `unit` (l,) in which they are reported: value + unit · state. All become others in
    `wander_s`.
    """

    arrays: LearningArrays
    names: tuple[str, ...]
    states: NDArray[np.int64]
    value: FloatArray
    unit: FloatArray
    wander_s: float = WANDER_S

    def estimates(self, x: FloatArray, P: FloatArray) -> dict[str, tuple[float, float]]:
        """What is learnt, by name, with its σ: from the states (L,), the last of an estimator's, and their
        covariance (L, L).
        """
        value = self.value + self.unit * x[self.states]
        sigma = self.unit * np.sqrt(np.diag(P)[self.states])
        return dict(zip(self.names, zip(value.tolist(), sigma.tolist(), strict=True), strict=True))


def no_change(n_x: int, inputs: int) -> Change:
    """Return what a parameter does that does nothing."""
    zeros = np.zeros(n_x)
    no_inputs = np.zeros((inputs, n_x))
    return Change(zeros, zeros, zeros, zeros, -1, -1, -1, no_inputs, zeros, zeros, np.zeros(inputs), 0.0, 0.0)


def learning_of(
    parameters: Sequence[Parameter],
    learnt: Collection[str],
    n_x: int,
    inputs: int,
    *,
    ambient: int = 0,
    rest_P: FloatArray | None = None,
) -> Learning:
    """Return the states of parameters, of a plant of n_x states with so many known inputs, of which those are
    `learnt` whose kind's key is among these; `rest_P` as in `LearningArrays`, None where no screw rests.
    """
    parameters = sorted(parameters, key=lambda p: p.kind.of_a_sensor)
    unchanged = no_change(n_x, inputs)
    change: dict[str, Any] = {
        name: np.array([getattr(p.change, name) for p in parameters], np.asarray(default).dtype).reshape(
            -1, *np.shape(default)
        )
        for name, default in unchanged._asdict().items()
    }
    learnt_states = [i for i, p in enumerate(parameters) if p.kind.key in learnt]
    arrays = LearningArrays(
        machine=sum(not p.kind.of_a_sensor for p in parameters),
        kind=np.array([p.kind for p in parameters], np.int64),
        of=np.array([p.of for p in parameters], np.int64),
        sigma=np.array([p.sigma for p in parameters], np.float64),
        held=np.array([i for i in range(len(parameters)) if i not in learnt_states], np.int64),
        **change,
        heated=change["heats"].any(axis=1).astype(np.int64),
        ambient=ambient,
        rests=int(rest_P is not None),
        rest_P=np.zeros((n_x, n_x)) if rest_P is None else rest_P,
        V=np.zeros((0, 0)),
        inverse=np.zeros((0, 0)),
    )
    return Learning(
        arrays,
        tuple(parameters[i].name for i in learnt_states),
        np.array(learnt_states, np.int64),
        np.array([parameters[i].value for i in learnt_states]),
        np.array([parameters[i].unit for i in learnt_states]),
    )
