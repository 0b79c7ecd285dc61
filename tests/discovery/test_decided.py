"""A doubt, the cycle proposed to decide it, run on another code's machine, and the answer with its log."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest

from observer import discover
from observer.files.logs import read_log
from tests.truth.machine.catalogue import AMBIGUOUS
from tests.truth.machine.cycles import Phase
from tests.truth.machine.generate import Case, logged, machine_of, trace, write_case
from tests.truth.machine.logs import write_log

pytestmark = pytest.mark.slow


def searched(folder: Path, logs: list[Path], name: str) -> dict[str, Any]:
    return discover(folder / "config.toml", logs).write(folder / name, report=name == "doubt")


def test_a_proposed_cycle_decides_between_a_motor_and_a_bearing(tmp_path: Path) -> None:
    """At one speed from the first row to the last, a motor's heat and a bearing's are the same."""
    doubt = AMBIGUOUS[0]
    case = Case(f"decided.{doubt.label}", doubt.effects, 17, doubt.cycle, unknown=doubt.unknown, logs=2)
    logs = write_case(case, tmp_path)
    before = searched(tmp_path, logs, "doubt")
    assert before["verdict"] == "ambiguous"
    assert ["motor_heat at left"] in before["alternatives"]
    print(before["alternatives"])
    assert len(before["alternatives"]) > 1
    test = before["experiment"]
    print(test["name"], test["separation_sigma"], test["others"])
    assert test["separation_sigma"] > 3.0  # of the nearest two of all answers
    assert "discover NEW " in before["next"]["command"]
    assert shlex.quote(str(logs[0])) in before["next"]["command"]

    program = read_log(tmp_path / "doubt" / test["program"])
    assert program.time_s[-1] == test["duration_s"]
    phases = tuple(
        Phase(p["duration_s"], p["speed_rpm"], *((p["low_m"], p["high_m"]) if p["speed_rpm"] else (0.2, 0.8)))
        for p in test["phases"]
    )
    run = logged(case, "test", trace(case, "test", machine_of(case), phases))
    new = tmp_path / "test.csv.gz"
    write_log(new, run.time_s, run.values)
    after = searched(tmp_path, [new, *logs], "decided")
    print(after["reason"], after["effects"])
    assert after["verdict"] == "named"
    (effect,) = after["effects"]
    assert (effect["kind"], effect["target"]) == ("motor_heat", "left")
    low, high = effect["parameters"]["heat_W"]["ci95"]
    assert low <= doubt.effects[0]["heat_W"] <= high
    assert after["experiment"] is None
