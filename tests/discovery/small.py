"""A small bar's logs as a search sees them: prepared runs, their evidence, and the problem they make."""

from __future__ import annotations

from collections.abc import Sequence

from observer.config.machine import Config
from observer.fit.parameters import free_keys
from observer.fit.problem import Problem
from observer.fit.runs import prepare
from observer.frames import FrameBlock


def problem_of(config: Config, logs: Sequence[FrameBlock]) -> Problem:
    """What hypotheses about these logs share."""
    runs = [prepare(config, [log], f"log {i + 1}") for i, log in enumerate(logs)]
    return Problem.of(config, free_keys(config), runs)
