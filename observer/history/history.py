"""What is asked of `observer identify`, and what it returns: options of a method, heats over a log."""

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

    `regularisation` multiplies the weight of the configured prior. `order` is that of the prior: 1 for heats
    as a random walk, from an uncertain field; 0, as in the papers, for independent heats of each step, from a
    screw of one temperature. `seed` is that of all random draws.
    """

    method: Method = "smoother"
    regularisation: float | None = None
    parameter_choice: ParameterChoice | None = None
    order: int | None = None
    gradient: Gradient | None = None
    seed: int = 0

    def check(self) -> None:
        """Raise `UserError` where an option is unknown or not of the method, or two contradict each other."""
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

    Shapes, with m_e estimated sources and s sensors: `heat_W`, `heat_sigma_W` (K, m_e), NaN where nothing is
    known; `residual_K` (K, s), measured minus explained temperature, NaN where no value was used. `details`
    are figures of the method by name; `warnings` are sentences.
    """

    time_s: FloatArray
    heat_W: FloatArray
    heat_sigma_W: FloatArray
    residual_K: FloatArray
    details: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.time_s)
