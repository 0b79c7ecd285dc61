"""Uncertain parameters of a machine, as states beside its heats: learnt while it runs, or considered.

Each is a small change θ of the configuration with a linear effect:

    dx/dt = … + c θ,  c = A x + B q + E z + f,        y_i = … + (C x + F z + d) θ.

Live filters, fixed gains, predictions within tolerances and `check` all take these arrays. All parameters
wander as first-order Markov processes about 0, in a day, so that their σ never vanishes. A considered
parameter (Schmidt 1966) keeps its value while its covariances are carried.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from observer.config.estimator import Learnable
from observer.frames import FloatArray

WANDER_S = 86_400.0
"""Time constant of a parameter's random changes: films, clamps and laws differ from day to day."""
REST_K = 0.1
"""σ of a screw's temperature about the air's after a night."""


class Nuisance(IntEnum):
    """The kind of an uncertain parameter, of the machine or of a sensor; in the order of `Learnable`."""

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
        """Its name in `[tolerance]` and in `[estimator] learn`."""
        return str(get_args(Learnable)[self])

    @property
    def of_a_sensor(self) -> bool:
        """Whether it belongs to a sensor and not to the machine."""
        return self in (Nuisance.OFFSET, Nuisance.PLACE, Nuisance.LAG, Nuisance.GAIN)


class Change(NamedTuple):
    """The effect of one unit of a parameter, on a plant of n_x states with p known inputs.

    On dx/dt, A is diag(`rate_1_s`) + `into`ᵀ `feedback_row`. B q is `heats` times the effect of all heats,
    plus the effect of one law. One unit moves all the heat of the source `divided` from its place to `into`.
    E is `inputs` and f `steady`. On the reading of the parameter's sensor, C is `row`, F `row_known`
    and d `shift_K`. Filters replace A by that of the moving nut's current place, for the link with the number
    `link`.

    Attributes:
        rate_1_s: Diagonal of A, (n_x,).
        into: States that the parameter changes, (n_x,), or several such columns, (r, n_x).
        feedback_row: Row that reads the states, (n_x,), or one for each column, (r, n_x).
        heats: Factors on the effect of all heats, (n_x,).
        law: Source whose law is scaled, −1 without one.
        divided: Source whose heat is divided, −1 without one.
        link: Number of the link to a moving nut in the plant's coupling, −1 without one.
        inputs: E, (p, n_x).
        steady: f, (n_x,).
        row: Row C of the sensor, (n_x,).
        row_known: Row F of the sensor, (p,).
        shift_K: Offset d of the sensor.
        lag_s: Delay of the sensor.
    """

    rate_1_s: FloatArray
    into: FloatArray
    feedback_row: FloatArray
    heats: FloatArray
    law: int
    divided: int
    link: int
    inputs: FloatArray
    steady: FloatArray
    row: FloatArray
    row_known: FloatArray
    shift_K: float
    lag_s: float


class Parameter(NamedTuple):
    """An uncertain parameter. It is reported as value + unit · state.

    Attributes:
        kind: Its kind.
        of: Number of its end, estimated heat or sensor.
        sigma: Its prior σ in the unit of its state: relative, or in K, W/K, m or s.
        change: The effect of one unit.
        name: Its name in results, if it is learnt.
        value: Its value in the configuration.
        unit: Its unit in results.
    """

    kind: Nuisance
    of: int
    sigma: float
    change: Change
    name: str = ""
    value: float = 0.0
    unit: float = 1.0


class LearningArrays(NamedTuple):
    """L uncertain parameters as arrays for the kernels, those of the machine first; L may be 0.

    The fields of `Change` have an axis (L, …) in front; `into` and `feedback_row` (K, n_x) contain the
    columns of all parameters. In a plant of another basis, the effects of the machine's parameters are
    described on the states x = V ξ.

    Attributes:
        machine: Number of the machine's parameters.
        kind: As in `Parameter`, (L,).
        of: As in `Parameter`, (L,).
        sigma: As in `Parameter`, (L,).
        considered: Numbers of the parameters that are considered only, (h,).
        first: Number of the first column of each parameter in `into`, (L + 1,).
        heated: Whether each has a part in the effect of the heats, (L,).
        ambient: Column of the ambient among the known inputs.
        rests: 1 if `rest_P` applies.
        rest_P: Covariance of a screw's temperature against the air's after a night, K², (n_x, n_x).
        V: Basis of the states, (n_x, n_x); empty if ξ is x.
        inverse: Inverse of V; empty if ξ is x.
    """

    machine: int
    kind: NDArray[np.int64]
    of: NDArray[np.int64]
    sigma: FloatArray
    considered: NDArray[np.int64]
    rate_1_s: FloatArray
    into: FloatArray
    feedback_row: FloatArray
    heats: FloatArray
    law: NDArray[np.int64]
    divided: NDArray[np.int64]
    link: NDArray[np.int64]
    inputs: FloatArray
    steady: FloatArray
    row: FloatArray
    row_known: FloatArray
    shift_K: FloatArray
    lag_s: FloatArray
    first: NDArray[np.int64]
    heated: NDArray[np.int64]
    ambient: int
    rests: int
    rest_P: FloatArray
    V: FloatArray
    inverse: FloatArray

    def drives(
        self, x: FloatArray, B: FloatArray, law_W: FloatArray, heat_W: FloatArray, z: FloatArray
    ) -> FloatArray:
        """Return c, the effect of one unit of each parameter on dx/dt, (n_x, L).

        Args:
            x: States of the plant, (n_x,).
            B: Input columns of the heats, (n_x, m).
            law_W: Heats by law, W, (m,).
            heat_W: Heats in fact, W, (m,).
            z: Known inputs, (p,).
        """
        turned = len(self.V) > 0
        if turned:
            x, B = self.V @ x, self.V @ B
        passed, driven = self.into * (self.feedback_row @ x)[:, None], B @ heat_W
        c = self.rate_1_s * x + np.add.reduceat(passed, self.first[:-1]) + self.heats * driven
        c += np.einsum("ipa,p->ia", self.inputs, z) + self.steady
        by_law = self.law >= 0
        c[by_law] += (B * law_W).T[self.law[by_law]]
        for i in np.flatnonzero(self.divided >= 0):
            source = self.divided[i]
            c[i] += (self.into[self.first[i]] - B[:, source]) * heat_W[source]
        return np.asarray(self.inverse @ c.T if turned else c.T)

    def feedback(self, theta: FloatArray) -> FloatArray:
        """Return ∂(c θ)/∂x, 1/s, (n_x, n_x), at parameters θ.

        Args:
            theta: The parameters, (L,).
        """
        by_column = np.repeat(theta, np.diff(self.first))
        A = np.diag(theta @ self.rate_1_s) + (self.into.T * by_column) @ self.feedback_row
        return self.inverse @ A @ self.V if len(self.V) else A

    def in_basis(self, V: FloatArray, inverse: FloatArray) -> LearningArrays:
        """Return the same for other states ξ with x = V ξ.

        Args:
            V: The basis, (n_x, n_x).
            inverse: Its inverse, (n_x, n_x).
        """
        row = self.row @ V
        if len(self.V):
            V, inverse = self.V @ V, inverse @ self.inverse
        return self._replace(V=V, inverse=inverse, row=row)

    def described_on(self, V: FloatArray, inverse: FloatArray) -> LearningArrays:
        """Return the same, described on the states V x.

        `rate_1_s` and `heats`, which act on each state separately, are described on V x already.

        Args:
            V: The map, (n_x, n_x).
            inverse: Its inverse, (n_x, n_x).
        """
        return self._replace(
            into=self.into @ V.T,
            feedback_row=self.feedback_row @ inverse,
            inputs=self.inputs @ V.T,
            steady=self.steady @ V.T,
            V=V,
            inverse=inverse,
        )

    def entries(self, x: FloatArray, z: FloatArray) -> FloatArray:
        """Return C x + F z + d, the effect of one unit of each parameter on its sensor, K or µm, (L,).

        The entries of lags need more than these, and are 0 here.

        Args:
            x: States of the plant, (n_x,).
            z: Known inputs, (p,).
        """
        return np.asarray(self.row @ x + self.row_known @ z + self.shift_K)


_PER_COLUMN = ("into", "feedback_row")
_PER_PARAMETER = ("kind", "of", "sigma", "heated", *(f for f in Change._fields if f not in _PER_COLUMN))


def of_parameters(arrays: LearningArrays, selected: NDArray[np.int64]) -> LearningArrays:
    """Return the arrays of some parameters; all of them are learnt.

    Args:
        arrays: The arrays.
        selected: Numbers of the parameters in the new order, the machine's first, (r,).
    """
    fields = {name: getattr(arrays, name)[selected] for name in _PER_PARAMETER}
    columns = [np.arange(arrays.first[i], arrays.first[i + 1]) for i in selected]
    numbers = np.concatenate([np.zeros(0, np.int64), *columns])
    fields |= {name: getattr(arrays, name)[numbers] for name in _PER_COLUMN}
    fields["first"] = _first([len(c) for c in columns])
    machine = int((selected < arrays.machine).sum())
    return arrays._replace(machine=machine, considered=np.zeros(0, np.int64), **fields)


def joined(arrays: LearningArrays, added: LearningArrays) -> LearningArrays:
    """Return the arrays with additional parameters at their end.

    The numbers of the machine's and of considered parameters stay those of `arrays`.
    """
    fields: dict[str, Any] = {
        name: np.concatenate([getattr(arrays, name), getattr(added, name)])
        for name in (*_PER_PARAMETER, *_PER_COLUMN)
    }
    fields["first"] = _first([*np.diff(arrays.first), *np.diff(added.first)])
    return arrays._replace(**fields)


@dataclass(frozen=True, slots=True)
class Learning:
    """Uncertain parameters, and the names of the learnt ones. A result is value + unit · state.

    Attributes:
        arrays: The parameters.
        names: Names of the learnt ones, (l,).
        states: Their numbers among the parameters, (l,).
        value: Their values in the configuration, (l,).
        unit: Their units in results, (l,).
        wander_s: Time constant of all parameters' random changes.
    """

    arrays: LearningArrays
    names: tuple[str, ...]
    states: NDArray[np.int64]
    value: FloatArray
    unit: FloatArray
    wander_s: float = WANDER_S

    def estimates(self, x: FloatArray, P: FloatArray) -> dict[str, tuple[float, float]]:
        """Return the learnt values with their σ, by name, in the units of the names.

        Args:
            x: States of the parameters, the last of an estimator's, (L,).
            P: Their covariance, (L, L).
        """
        value = self.value + self.unit * x[self.states]
        sigma = self.unit * np.sqrt(np.diag(P)[self.states])
        return dict(zip(self.names, zip(value.tolist(), sigma.tolist(), strict=True), strict=True))


def _first(counts: Sequence[int]) -> NDArray[np.int64]:
    """The number of the first column of each parameter, (L + 1,), from how many each has."""
    return np.cumsum([0, *counts], dtype=np.int64)


def no_change(n_x: int, inputs: int) -> Change:
    """Return a change without effect.

    Args:
        n_x: Number of states of the plant.
        inputs: Number of its known inputs.
    """
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
    """Return the states of parameters, those of the machine first.

    Args:
        parameters: The parameters.
        learnt: Keys of `[tolerance]`, or `law`, whose parameters are learnt; the others are considered.
        n_x: Number of states of the plant.
        inputs: Number of its known inputs.
        ambient: Column of the ambient among them.
        rest_P: Covariance of a screw's temperature against the air's after a night, K², (n_x, n_x). None if
            no screw rests.
    """
    parameters = sorted(parameters, key=lambda p: p.kind.of_a_sensor)
    unchanged = no_change(n_x, inputs)
    change: dict[str, Any] = {
        name: np.array([getattr(p.change, name) for p in parameters], np.asarray(default).dtype).reshape(
            -1, *np.shape(default)
        )
        for name, default in unchanged._asdict().items()
        if name not in _PER_COLUMN
    }
    for name in _PER_COLUMN:
        change[name] = np.vstack([np.zeros((0, n_x)), *(getattr(p.change, name) for p in parameters)])
    learnt_states = [i for i, p in enumerate(parameters) if p.kind.key in learnt]
    arrays = LearningArrays(
        machine=sum(not p.kind.of_a_sensor for p in parameters),
        kind=np.array([p.kind for p in parameters], np.int64),
        of=np.array([p.of for p in parameters], np.int64),
        sigma=np.array([p.sigma for p in parameters], np.float64),
        considered=np.array([i for i in range(len(parameters)) if i not in learnt_states], np.int64),
        **change,
        first=_first([len(np.atleast_2d(p.change.into)) for p in parameters]),
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
