"""An effect appears in a machine while a service records it: searched, found, adopted, and the gap shrinks.

The machine is the independent two-dimensional one; its hours are played to the parts of the service as fast
as they go. The commands are the program's own.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.align.aligner import AlignPlan
from observer.estimate.pipeline import MachineModel
from observer.fit.runs import joined
from observer.frames import FrameBlock
from observer.installation import Installation, load
from tests.logs.recordings import recorded, thinned
from tests.system.plant import run_observer
from tests.truth.machine.effects import Effect
from tests.truth.machine.generate import Case, Run, logged, machine_of, trace
from tests.truth.machine.logs import configuration

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(600)]

BEGIN_s, BREAK_s = 1.79e9, 600.0
STEP_s = 1.0
EFFECT = Effect("end_conduction", "left", {"conductance_W_K": 0.3})
BEFORE, AFTER = Case("adopted"), Case("adopted", (EFFECT,))
"""The same machine without and with what appears."""


def _observer(*words: str) -> str:
    done = run_observer(*words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _run(case: Case, run: str) -> Run:
    machine = machine_of(case)
    return logged(case, run, trace(case, run, machine))


class Plant:
    """A machine that is recorded as it runs; what the service sees is kept."""

    def __init__(self, config: Installation) -> None:
        self._config = config
        self._now_s = BEGIN_s

    def works(self, run: Run) -> list[FrameBlock]:
        """Have it run through a programme of work."""
        time_s, values = thinned(run.time_s, run.values, STEP_s)
        folder = self._config.record.directory
        assert folder is not None
        seen = recorded(
            folder, AlignPlan.of(self._config), self._now_s, time_s, run.channels, values, rotate_rows=5000
        )
        self._now_s += float(run.time_s[-1]) + BREAK_s
        return seen


class Watch:
    """What the service watches beside its estimator."""

    def __init__(self, config: Installation) -> None:
        machine = MachineModel.of(config, learns=True)
        gap = machine.gap()
        assert gap is not None
        self.gap, self._drive, self._state = gap, machine.drive, machine.drive.initial()

    def see(self, frames: list[FrameBlock]) -> None:
        """Take the frames of some hours."""
        self._state, inputs = self._drive.run(self._state, joined(frames))
        self.gap.take(inputs)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    text = configuration(AFTER.unmodelled, known=True)
    text += f'\n[record]\ndirectory = "{tmp_path / "recordings"}"\n\n[estimator]\nperiod_s = {STEP_s}\n'
    path.write_text(text, encoding="utf-8")
    return path


def test_what_appears_is_found_in_the_recordings_and_adopted_it_explains_the_readings(config, tmp_path):
    plant = Plant(load(config))
    watch = Watch(load(config))
    watch.see(plant.works(_run(BEFORE, "a")))
    assert watch.gap.departure is None  # nothing is wrong yet
    for name in ("a", "b", "c"):
        watch.see(plant.works(_run(AFTER, name)))
    departure = watch.gap.departure
    assert departure is not None
    assert departure.sensor == "t1"  # next to the end that loses heat
    hours = sum(_run(AFTER, name).time_s[-1] for name in ("a", "b", "c")) + 2 * BREAK_s
    found = tmp_path / "found"
    said = _observer(
        "discover",
        "--recent",
        f"{hours / 60.0:.0f}min",
        "--config",
        str(config),
        "--output",
        str(found),
    )
    assert said.count("searched: ") == 3
    assert "end_conduction at left" in said

    _observer("adopt", str(found), "--config", str(config))
    assert config.read_bytes() == (found / "config.toml").read_bytes()
    again = Watch(load(config))
    for name in ("b", "c"):
        again.see(plant.works(_run(AFTER, name)))
    assert again.gap.departure is None
    assert "adopted" in _observer("adopt", "--status", "--config", str(config))
