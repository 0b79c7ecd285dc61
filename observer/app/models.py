"""What changes a model: calibration, what was learnt, and the search for effects."""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from observer.align.aligner import AlignPlan, doubts, frames_of_log
from observer.app.logs import channels_of
from observer.errors import ConfigError, LogError
from observer.estimate.pipeline import MachineModel
from observer.files.folders import results_in, write_json
from observer.frames import FrameBlock
from observer.installation import Installation, load

if TYPE_CHECKING:  # the other commands start without the search
    from observer.align.unit_errors import Misread
    from observer.discovery.discover import Discovery


def calibrate(
    log_paths: Sequence[Path], config_path: Path, output: Path, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Fit the free parameters and the process noise; write `config.toml` and `calibration.json`.

    Returns the content of `calibration.json`.
    """
    from observer.discovery.result import calibration_result
    from observer.fit.calibrate import calibrate as fit
    from observer.fit.process_noise import fit_noise
    from observer.installation import write_back

    config = load(config_path)
    progress("reading logs")
    searched = config_path.read_bytes()
    runs, odd, _ = _runs(log_paths, config)
    with results_in(output) as part:
        found = fit(config, runs, lambda n, rms_K: progress(f"fit {n}: {rms_K:.4f} K rms"))
        progress("process noise by maximum likelihood")
        noise = fit_noise(found.config, runs)
        result = calibration_result(found, noise) | {"doubts": odd}
        result = _about(searched, [path.name for path in log_paths]) | result
        text = write_back(config_path.read_text(encoding="utf-8"), found.values | found.left | noise)
        (part / "config.toml").write_text(text, encoding="utf-8")
        write_json(part / "calibration.json", result)
    return result


def learned(config_path: Path, output: Path) -> dict[str, tuple[float, float]]:
    """Write the configuration with what its service has learnt, by its checkpoint, as `config.toml`, and what
    that is as `learned.json`.

    Returns what has been learnt, with σ. Raises `ConfigError` where nothing is learnt or left to go by.
    """
    from observer.estimate.checkpoint import CheckpointFit, UnfitError
    from observer.estimate.checkpoint import load as load_checkpoint
    from observer.fit.tolerance import learnt_changes
    from observer.installation import with_effects, write_back

    config, searched = load(config_path), config_path.read_bytes()
    machine, file = MachineModel.of(config, learns=True), config.checkpoint_file
    if (learning := machine.plant.learning) is None or not learning.names:
        raise ConfigError(
            f"{config_path}: estimator.learn: nothing is learnt; name what the estimator is to learn"
        )
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
        write_json(part / "learned.json", _about(searched, [file.name]) | {"parameters": parameters})
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

    Where an effect that is not named explains most of an unknown, `candidate.toml` is written instead.

    With `recent_s` the logs are what the service has recorded in so many last seconds; `alone`, in this
    process only, for the other cores have work of their own. Returns what was
    found, and the content of `result.json`.
    """
    from observer.discovery.discover import discover as find
    from observer.discovery.result import discovery_result
    from observer.discovery.suspects import Suspect
    from observer.discovery.workers import WorkerPool
    from observer.report.advice import next_step
    from observer.report.discovery import write_discovery_report

    config = load(config_path)
    progress("reading logs", 0.0)
    searched = config_path.read_bytes()
    if recent_s is None:
        runs, names = _runs(log_paths, config, rightly=True), [path.name for path in log_paths]
    else:
        runs, names = _recent(config, recent_s)
    corrected = [Suspect("units", m.channel, m.unit, m.text) for m in runs.misread]
    with results_in(output) as part:
        with WorkerPool(alone=alone) as pool:
            found = find(config, runs.frames, progress, pool, corrected)
        result = _about(searched, names) | discovery_result(found) | {"doubts": runs.odd}
        last = shlex.join(map(str, log_paths)) if recent_s is None else f"--recent {recent_s / 3600.0:g}h"
        result["next"] = next_step(result, last, str(config_path), str(output))
        _write_configurations(part, config_path, found, result)
        write_json(part / "result.json", result)
        if report:
            progress("writing the report", 0.97)
            write_discovery_report(part / "report.html", found, result, names)
    return found, result


def _write_configurations(folder: Path, config_path: Path, found: Discovery, result: dict[str, Any]) -> None:
    """Write what was named as `config.toml`, or what explains most of an unknown as `candidate.toml`."""
    from observer.discovery.result import CANDIDATE, calibrated_of
    from observer.installation import with_effects, write_back
    from observer.report.advice import candidate_comment

    partial = result["partial"]
    if found.verdict.kind == "named":
        name, fit, comment = "config.toml", found.verdict.fit, ""
    elif found.partial is not None and partial is not None and partial["candidate"] is not None:
        name, fit = CANDIDATE, found.partial.trial.fit
        comment = candidate_comment(partial)
    else:
        return
    values = {key: entry["value"] for key, entry in calibrated_of(fit).items()}
    text = write_back(config_path.read_text(encoding="utf-8"), values)
    text = with_effects(text, fit.config.effect[len(found.problem.config.effect) :])
    (folder / name).write_text(comment + text, encoding="utf-8")


class _Runs(NamedTuple):
    """The frames of each log, what is doubtful about the logs as they are, and what was in another unit."""

    frames: list[list[FrameBlock]]
    odd: list[str]
    misread: tuple[Misread, ...] = ()


def _runs(log_paths: Sequence[Path], config: Installation, *, rightly: bool = False) -> _Runs:
    """Read logs; `rightly`, those in which a channel is in another unit in the one expected."""
    from observer.align.unit_errors import read_rightly
    from observer.fit.parameters import lawless

    _refuse_twice(log_paths)
    plan, runs = AlignPlan.of(config), []
    odd = [words] if (words := lawless(config)) is not None else []
    misread: dict[Misread, None] = {}
    for path in log_paths:
        log = channels_of(path, config)
        frames = list(frames_of_log(log, plan))
        paths = [block.path for block in frames]
        odd += [f"{path.name}: {sentence}" for sentence in doubts(log, paths, config)]
        log, found = read_rightly(log, config, paths) if rightly else (log, ())
        misread |= dict.fromkeys(found)
        runs.append(list(frames_of_log(log, plan)) if found else frames)
    return _Runs(runs, odd, tuple(misread))


def _refuse_twice(log_paths: Sequence[Path]) -> None:
    """Raise `LogError` where two logs are one: it would be the proof of what was found in it."""
    seen: dict[str, Path] = {}
    for path in log_paths:
        try:
            with open(path, "rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError:
            continue  # who reads it says why it cannot be
        if (before := seen.setdefault(content, path)) is not path:
            raise LogError(f"{path}: holds the same as {before}; give each log once")


def _recent(config: Installation, last_s: float) -> tuple[_Runs, list[str]]:
    """What the service recorded lately, a run for each stretch, and what each is called."""
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
    return _Runs(runs, odd), names


def _about(searched: bytes, names: Sequence[str]) -> dict[str, Any]:
    """What a result was made of: program, logs, and the text of the configuration."""
    return {
        "version": version("ballscrew-observer"),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "logs": list(names),
        "config_sha256": hashlib.sha256(searched).hexdigest(),
    }
