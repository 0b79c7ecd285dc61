"""How long a search of some hours at 20 Hz takes: `python -m campaigns.long_recording FOLDER`.

The machine is the independent one with a loss at its left end, recorded as a service would; thermocouples and
air come once a second, position and speed with each tick.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from observer.align.aligner import AlignPlan
from observer.installation import load
from observer.record.recent import stretches
from tests.logs.recordings import recorded
from tests.truth.machine import generate
from tests.truth.machine.effects import Effect
from tests.truth.machine.logs import CHANNELS, configuration

STEP_S, SLOW = 0.05, 20
CASE = generate.Case("long", (Effect("end_conduction", "left", {"conductance_W_K": 0.5}),))


def main(folder: Path) -> None:
    """Record, then time reading and searching."""
    folder.mkdir(parents=True)
    path = folder / "config.toml"
    text = configuration(CASE.unmodelled, known=True)
    path.write_text(
        f'{text}\n[record]\ndirectory = "{folder}/recordings"\n\n[estimator]\nperiod_s = {STEP_S}\n'
    )
    config = load(path)
    assert config.record.directory is not None
    begin_s, slow = 1.79e9, [i for i, name in enumerate(CHANNELS) if name.endswith("degC")]
    generate.sample_times_s = lambda length_s, *_: STEP_S * np.arange(round(length_s / STEP_S))  # type: ignore[attr-defined]
    for run in generate.runs_of(CASE):
        values = run.values.copy()
        values[np.ix_(np.arange(len(values)) % SLOW != 0, slow)] = np.nan
        recorded(
            config.record.directory, AlignPlan.of(config), begin_s, run.time_s, CHANNELS, values,
            rotate_rows=200_000,
        )  # fmt: skip
        begin_s += float(run.time_s[-1]) + 120.0
    begun_s = time.monotonic()
    found = stretches(config.record, "rig-x", AlignPlan.of(config), 8 * 3600.0)
    took_s, frames = time.monotonic() - begun_s, sum(len(s.frames) for s in found)
    hours = sum(s.end_s - s.begin_s for s in found) / 3600.0
    print(f"{hours:.1f} h in {frames} frames, read in {took_s:.0f} s", flush=True)
    begun_s = time.monotonic()
    command = ["discover", "--recent", "8h", "--config", str(path), "--output", str(folder / "found")]
    subprocess.run([sys.executable, "-m", "observer", *command], check=True)
    most_MB = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    print(f"searched in {time.monotonic() - begun_s:.0f} s, with {most_MB:.0f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
