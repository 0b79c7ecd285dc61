"""Commands that change a model: learnt parameters, search for effects; results as files."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from observer.align.aligner import AlignPlan
from observer.errors import ConfigError
from observer.estimate.pipeline import MachineModel
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.installation import Installation, load
from observer.library.fitting import RunsOfLogs, about, runs_of
from observer.library.given import channels_of

if TYPE_CHECKING:  # the other commands start without the search
    from observer.discovery.discover import Discovery


def learned(config_path: Path, output: Path) -> dict[str, tuple[float, float]]:
    """Write the configuration with the parameters that its service has learnt, from its checkpoint, as
    `config.toml`, and these as `learned.json`.

    Returns the learnt parameters with σ. Raises `ConfigError` where nothing is learnt or no checkpoint
    exists.
    """
    from observer.estimate.checkpoint import CheckpointFit, UnfitError
    from observer.estimate.checkpoint import load as load_checkpoint
    from observer.fit.tolerance import learnt_changes
    from observer.installation import with_effects, write_back

    config, searched = load(config_path), config_path.read_bytes()
    machine, file = MachineModel.of(config, learns=True), config.checkpoint_file
    if (learning := machine.plant.learning) is None or not learning.names:
        raise ConfigError(f"{config_path}: estimator.learn: nothing is learnt; name the parameters to learn")
    if file is None:
        raise ConfigError(f"{config_path}: the service keeps no checkpoint; give [checkpoint] directory")
    try:
        stood = load_checkpoint(file, CheckpointFit.of(machine)).estimator
    except UnfitError as error:
        raise ConfigError(f"{file}: {error}; run the service by {config_path.name} for some hours") from None
    first = len(stood.x_hat) - machine.plant.learnt
    learnt = learning.estimates(stood.x_hat[first:], stood.P[first:, first:])
    offer = learnt_changes(config, learnt)
    with results_in(output) as part:
        text = write_back(config_path.read_text(encoding="utf-8"), offer.values | offer.left)
        (part / "config.toml").write_text(with_effects(text, offer.biases), encoding="utf-8")
        parameters = {key: {"value": value, "sigma": sigma} for key, (value, sigma) in learnt.items()}
        write_json(part / "learned.json", about(searched, [file.name]) | {"parameters": parameters})
    return learnt


def discover(
    config_path: Path,
    log_paths: Sequence[Path],
    output: Path,
    progress: Callable[[str, float], None],
    *,
    recent_s: float | None = None,
    report: bool = True,
    alone: bool = False,
) -> tuple[Discovery, dict[str, Any]]:
    """Find the effect that the model lacks; write `result.json`, `report.html` and, if named, `config.toml`.

    Of an unknown, `candidate.toml` is written instead, with the effect that explains most of it.

    With `recent_s` the logs are what the service has recorded in so many last seconds; `alone`, in this
    process only, for the other cores have work of their own. Returns what was
    found, and the content of `result.json`.
    """
    from observer.library.searching import searched

    config = load(config_path)
    progress("reading logs", 0.0)
    source = config_path.read_bytes()
    if recent_s is None:
        logs = [channels_of(path, config) for path in log_paths]
        runs, names = runs_of(logs, config, rightly=True), [path.name for path in log_paths]
    else:
        runs, names = _recent(config, recent_s)
    last = shlex.join(map(str, log_paths)) if recent_s is None else f"--recent {recent_s / 3600.0:g}h"
    with results_in(output) as part:
        done = searched(config, source, runs, names, progress, alone=alone)
        if report:
            progress("writing the report", 0.97)
        result = done.write(part, last, str(config_path), str(output), report=report)
    return done.found, result


def _recent(config: Installation, last_s: float) -> tuple[RunsOfLogs, list[str]]:
    """The service's recent recordings, a run for each stretch, with their names."""
    from observer.align.plausibility import doubts_of_log
    from observer.record.recent import stretches

    name = f"{config.machine.name}-{config.machine.axis}"
    runs, odd, names = [], [], []
    for stretch in stretches(config.record, name, AlignPlan.of(config), last_s):
        frames = stretch.frames
        runs.append([frames])
        names.append(str(stretch))
        odd += [
            f"{names[-1]}: {sentence}"
            for sentence in doubts_of_log(config, frames.values, frames.channels, [frames.path])
        ]
    return RunsOfLogs(runs, odd), names
