"""Options and result of a heat history, `observer identify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from observer.errors import UserError, check_choice
from observer.frames import FloatArray

Method = Literal["smoother", "tikhonov", "conjugate-gradient"]
ParameterChoice = Literal["discrepancy", "gcv", "l-curve", "ico"]
Gradient = Literal["adjoint", "central-differences"]


class MethodOptions(NamedTuple):
    """The method and its options; None is the method's own default.

    Attributes:
        method: The method.
        regularisation: Factor on the weight of the configured prior, for tikhonov.
        parameter_choice: Rule that chooses this factor, for tikhonov; by default `gcv`.
        order: Order of the prior. 1: heats as a random walk, from an uncertain field. 0: independent heats of
            each step, from a screw of one temperature, as in the papers.
        gradient: Gradient of conjugate-gradient; by default `adjoint`.
        seed: Seed of all random draws.
    """

    method: Method = "smoother"
    regularisation: float | None = None
    parameter_choice: ParameterChoice | None = None
    order: int | None = None
    gradient: Gradient | None = None
    seed: int = 0

    def check(self) -> None:
        """Check the options against each other.

        Raises:
            UserError: If an option is unknown or not of the method, if a number is out of range, or if two
                options contradict each other.
        """
        for name, allowed in (
            ("method", Method),
            ("parameter_choice", ParameterChoice),
            ("gradient", Gradient),
        ):
            if (value := getattr(self, name)) is not None:
                check_choice(name, value, get_args(allowed))
        if self.order not in (None, 0, 1):
            raise UserError(f"order = {self.order!r}: give 0 or 1")
        belongs = {
            "regularisation": ("tikhonov",),
            "parameter_choice": ("tikhonov",),
            "order": ("tikhonov", "conjugate-gradient"),
            "gradient": ("conjugate-gradient",),
        }
        for name, methods in belongs.items():
            if getattr(self, name) is not None and self.method not in methods:
                option = name.replace("_", "-")
                raise UserError(
                    f"--{option} belongs to --method {' or '.join(methods)}, not {self.method}; leave it out"
                )
        if self.regularisation is not None:
            if self.parameter_choice is not None:
                raise UserError(
                    "--regularisation fixes what --parameter-choice would choose; give one of them"
                )
            if not (np.isfinite(self.regularisation) and self.regularisation > 0.0):
                raise UserError(f"--regularisation {self.regularisation:g}: give a number above 0")
        if self.gradient == "central-differences" and self.order is not None:
            raise UserError(
                "--gradient central-differences takes each step by itself, without a prior; leave out --order"
            )


@dataclass(frozen=True, slots=True)
class HeatHistory:
    """The estimated heats at K steps, each from all measurements of the log, before and after it.

    Attributes:
        time_s: Times of the steps, s since the epoch, (K,).
        heat_W: Heats of the estimated sources, W, (K, m_e), NaN where unknown.
        heat_sigma_W: Their σ, W, (K, m_e).
        residual_K: Measured minus explained temperature, K, (K, s), NaN where no value was used.
        details: Figures of the method by name, such as `misfit`.
        warnings: Sentences for the user.
    """

    time_s: FloatArray
    heat_W: FloatArray
    heat_sigma_W: FloatArray
    residual_K: FloatArray
    details: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.time_s)
