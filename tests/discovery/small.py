"""A small bar's logs as a search sees them: prepared runs, their evidence, and the problem they make."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from observer.config import Config
from observer.fit.evidence import gather
from observer.fit.forward import Forward
from observer.fit.parameters import free_keys
from observer.fit.problem import Problem
from observer.fit.runs import prepare
from observer.frames import FrameBlock


def problem_of(config: Config, logs: Sequence[FrameBlock]) -> Problem:
    """What hypotheses about these logs share."""
    forward = Forward(config, [prepare(config, [log], f"log {i + 1}") for i, log in enumerate(logs)])
    noise_K = np.array([s.noise_K for s in config.sensor])
    return Problem(config, free_keys(config), forward, gather(forward.runs, noise_K))
