"""Which rows show where a nut was, and what is not named where they do not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from observer import discover
from observer.config.effects.catalogue import effect_class
from observer.config.machine import Config
from observer.discovery import nut_path
from observer.discovery.candidates import Candidate
from observer.discovery.nut_path import needs_path, positions_a_traverse, sparse_paths
from observer.fit.runs import prepare
from observer.frames import FloatArray, FrameBlock
from observer.kernels.path import SAMPLES_PER_TRAVERSE
from tests.logs.machines import config_of
from tests.logs.simulated import frames
from tests.truth.machine.effects import Effect
from tests.truth.machine.generate import Case, runs_of, write_case
from tests.truth.machine.logs import write_log

STROKE_M = 0.6


def shuttled(positions: float, rows: int = 200) -> FloatArray:
    """The places of a nut that runs to and fro, so many rows a traverse."""
    way = np.arange(rows) / positions + 0.37
    return np.asarray(0.2 + STROKE_M * np.abs((way + 1.0) % 2.0 - 1.0))


@pytest.mark.parametrize("positions", [1.3, 1.7, 2.3, 2.7, 3.4, 5.2, 9.6])
def test_positions_are_counted_by_turns_where_the_lead_is_not_known(positions: float) -> None:
    found = positions_a_traverse(shuttled(positions), 0.0, STROKE_M)
    print(f"{positions:.1f}: {found:.2f}")
    assert (found < SAMPLES_PER_TRAVERSE) == (positions < SAMPLES_PER_TRAVERSE)
    if positions > 2.0:
        assert found == pytest.approx(positions, rel=0.05)


def test_a_stroboscope_shows_a_creeping_nut_and_the_way_reveals_it() -> None:
    """One row for each run to and fro: the nut seems to creep; by its lead it runs 1.2 m from row to row."""
    creeping = shuttled(0.5 + 1e-4)
    assert positions_a_traverse(creeping, 0.0, STROKE_M) > 3.0
    assert positions_a_traverse(creeping, 2 * STROKE_M, STROKE_M) == pytest.approx(0.5)


def test_a_nut_at_rest_is_seen() -> None:
    assert positions_a_traverse(np.full(50, 0.3), 0.1, STROKE_M) == np.inf
    assert positions_a_traverse(np.array([0.1, 0.5, 0.1]), 0.1, STROKE_M) == np.inf  # too few to decide


def log_of(config: Config, row_s: float) -> FrameBlock:
    """A quarter of an hour at 1000 rpm and 5 mm a turn."""
    time_s = np.arange(0.0, 900.0, row_s)
    columns = {s.channel: np.full_like(time_s, 20.0) for s in config.sensor}
    place_m = 0.2 + STROKE_M * np.abs((time_s * 1000.0 / 60.0 * 0.005 / STROKE_M + 1.0) % 2.0 - 1.0)
    columns |= {"nut_position_m": place_m, "screw_speed_rpm": np.full_like(time_s, 1000.0)}
    return frames(config, time_s, columns)


@pytest.mark.parametrize(("row_s", "positions"), [(0.5, None), (2.0, None), (5.0, 1.3), (60.0, 0.6)])
def test_a_log_with_few_positions_is_doubted_with_a_remedy(row_s: float, positions: float | None) -> None:
    """A traverse lasts 7.2 s; without its lead the nut is taken to advance 1 mm a turn at least."""
    config = config_of(6, 3, 11, moving=True)
    runs = [prepare(config, [log_of(config, s)], f"log {i}") for i, s in enumerate((0.5, row_s), 1)]
    found = sparse_paths(config, runs)
    assert len(found) == (positions is not None)
    for suspect in found:
        assert (suspect.what, suspect.channel) == ("nut's way", "nut_position_m")
        assert float(suspect.by) == pytest.approx(positions, rel=0.2)
        assert "Log 2 shows" in suspect.text
        assert "no effect of it, or under it, is looked for" in suspect.text


@pytest.mark.parametrize("positions", [2.4999999, 2.46, 2.5, 2.51, 2.97, 3.0])
def test_the_search_asks_for_as_many_positions_as_the_model(
    positions: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(nut_path, "positions_a_traverse", lambda *_: positions)
    config = config_of(6, 3, 11, moving=True)
    row_s = 7.2 / positions
    runs = [prepare(config, [log_of(config, row_s)], "log")]
    found = sparse_paths(config, runs)
    assert bool(found) == (positions < SAMPLES_PER_TRAVERSE)
    for suspect in found:
        stated, needed, most_s = map(
            float, re.findall(r"[\d.]+(?= positions| are needed| s or)", suspect.text)
        )
        assert stated < needed == SAMPLES_PER_TRAVERSE
        assert most_s < row_s


@pytest.mark.parametrize(
    ("kind", "target", "fitted", "needs"),
    [
        ("friction_fade", "nut", (), True),
        ("attached_mass", "nut", (), True),
        ("dwell", "nut", (), True),
        ("local_heat", None, ("position_m", "heat_W"), True),
        ("friction_fade", "left", (), False),
        ("end_conduction", "left", (), False),
        ("surface_convection", None, (), False),
        ("sensor_lag", "t3", (), False),
    ],
)
def test_effects_of_the_nut_or_under_it_need_its_way(
    kind: str, target: str | None, fitted: tuple[str, ...], *, needs: bool
) -> None:
    candidate = Candidate(effect_class(kind), target, (), dict.fromkeys(fitted))  # type: ignore[arg-type]
    assert needs_path(candidate, config_of(3, 3, 3, moving=True)) == needs
    assert not needs_path(candidate, config_of(3, 3, 3))


RUN_IN = Effect("run_in", "nut", {"fraction": 0.5, "time_s": 1200.0})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("every", "logs", "hidden"), [(120, 3, ()), (16, 2, (RUN_IN,))], ids=["null", "run_in"]
)
def test_a_search_of_logs_with_few_positions_doubts_them_and_names_nothing_of_the_nut(
    every: int, logs: int, hidden: tuple[Effect, ...], tmp_path: Path
) -> None:
    """Rows 1 min apart with nothing hidden are none; 8 s apart, the nut's friction that settles is not named,
    though nothing else explains it.
    """
    case = Case("sparse", hidden, 901, typical=True, logs=logs)
    write_case(case, tmp_path)
    paths = []
    for i, run in enumerate(runs_of(case)):
        paths.append(tmp_path / f"sparse_{i}.csv.gz")
        write_log(paths[-1], run.time_s[every - 1 :: every], run.values[every - 1 :: every])
    config = tmp_path / "config.toml"
    discovery = discover(config, paths)
    found, result = discovery._search.discovery, discovery.document
    print(result["reason"], [t.candidate.name for t in found.search.ranking])
    assert result["verdict"] == ("unknown" if hidden else "none")
    assert [s["what"] for s in result["suspects"]] == ["nut's way"]
    assert "positions of nut a traverse" in result["reason"]
