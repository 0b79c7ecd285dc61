"""Calibration: logs as runs, the fit, and the configuration with the fitted values."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from observer.align.aligner import AlignPlan, doubts, frames_of_log, read_in, refuse_implausible
from observer.align.unit_errors import Misread, in_configured_units
from observer.errors import LogError
from observer.files.logs import Log
from observer.fit.parameters import lawless
from observer.frames import FrameBlock
from observer.installation import Installation, write_back


class RunsOfLogs(NamedTuple):
    """The runs of logs.

    Attributes:
        frames: The blocks of frames of each log, in the order of time.
        doubts: Sentences about the logs, before any conversion, each with the log's name.
        misread: The channels that were recorded in another unit than configured.
    """

    frames: list[list[FrameBlock]]
    doubts: list[str]
    misread: tuple[Misread, ...] = ()


def runs_of(logs: Sequence[Log], config: Installation, *, convert_units: bool = False) -> RunsOfLogs:
    """Return the runs of logs, each with its own initial field.

    Args:
        logs: Logs of one machine.
        config: The machine.
        convert_units: Convert a channel that was recorded in another unit than configured, and list it in
            `misread`.

    Raises:
        LogError: Two logs are identical, or a temperature or an input of a heat law is beyond its limits
            throughout a log.
    """
    _refuse_twice(logs)
    plan, runs = AlignPlan.of(config), []
    sentences = [words] if (words := lawless(config)) is not None else []
    misread: dict[Misread, None] = {}
    for log in logs:
        frames = list(frames_of_log(log, plan))
        paths = [block.path for block in frames]
        read = set[str]().union(*map(read_in, frames))
        sentences += [f"{log.path.name}: {sentence}" for sentence in doubts(log, paths, config, read)]
        converted, wrong_units = in_configured_units(log, config, paths) if convert_units else (log, ())
        refuse_implausible(converted, config, laws=True)
        misread |= dict.fromkeys(wrong_units)
        runs.append(list(frames_of_log(converted, plan)) if wrong_units else frames)
    return RunsOfLogs(runs, sentences, tuple(misread))


def recent_runs(config: Installation, last_s: float) -> tuple[RunsOfLogs, list[str]]:
    """Return a run for each stretch that the service has recorded recently, and the stretches' names.

    Args:
        config: The machine, with `[record]`.
        last_s: Seconds before the newest recorded row.

    Raises:
        ConfigError: The service records nothing, as `record.directory` is missing.
        LogError: A recording cannot be read, or every stretch is too short for a fit.
    """
    from observer.align.plausibility import doubts_of_log
    from observer.record.recent import stretches

    name = f"{config.machine.name}-{config.machine.axis}"
    runs, sentences, names = [], [], []
    for stretch in stretches(config.record, name, AlignPlan.of(config), last_s):
        frames = stretch.frames
        runs.append([frames])
        names.append(str(stretch))
        doubts_of_run = doubts_of_log(config, frames.values, frames.channels, [frames.path])
        sentences += [f"{names[-1]}: {sentence}" for sentence in doubts_of_run]
    return RunsOfLogs(runs, sentences), names


def _refuse_twice(logs: Sequence[Log]) -> None:
    """Raise `LogError` where two logs are identical, as the second could not prove what was found in the
    first.
    """
    path_by_digest: dict[bytes, Path] = {}
    for log in logs:
        content = hashlib.sha256(log.time_s.tobytes())
        content.update(log.values.tobytes())
        if content.digest() in path_by_digest:
            before = path_by_digest[content.digest()]
            raise LogError(f"{log.path}: holds the same as {before}; give each log once")
        path_by_digest[content.digest()] = log.path


def text_of(source: bytes) -> str:
    r"""Return the text of a configuration's file, its lines ended by `\n`, for an improved file to be
    written.
    """
    return source.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def provenance(source: bytes, names: Sequence[str]) -> dict[str, Any]:
    """Return the inputs of a result, as the first entries of each JSON document.

    Args:
        source: The bytes of the configuration's file.
        names: Names of the logs.

    Returns:
        `version` of this package, `date` in UTC (ISO 8601), `logs`, and `config_sha256`.
    """
    return {
        "version": version("ballscrew-observer"),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "logs": list(names),
        "config_sha256": hashlib.sha256(source).hexdigest(),
    }


def fitted(
    config: Installation, source: bytes, logs: Sequence[Log], progress: Callable[[str], None]
) -> tuple[dict[str, Any], str | None]:
    """Fit the free parameters and, where fitted values are better than configured ones, the process noise.

    Doubtful parts of the logs are left out first, and named under `left_out`.

    Args:
        config: The machine, with its free keys.
        source: The bytes of its file.
        logs: One log or several; the last, or the end of a single one, is held back.
        progress: Receives the stage of the work, about every second.

    Returns:
        The content of `calibration.json`, and the text of `config.toml`. The text is None where no fitted
            value is better than the configured one.

    Raises:
        ConfigError: A free key does not exist.
        LogError: The logs are too short, identical, or determine no parameter; with the parts left out.
    """
    from observer.discovery.result import calibration_result
    from observer.estimate.replay import nut_paths
    from observer.estimate.sound import sound_frames
    from observer.fit.calibrate import calibrate as fit
    from observer.fit.process_noise import fit_noise

    runs = runs_of(logs, config)
    progress("looking for doubtful parts")
    named = zip(runs.frames, logs, strict=True)
    sound = [sound_frames(config, blocks, log.path.name) for blocks, log in named]
    frames, left_out = [[log.frames] for log in sound], [text for log in sound for text in log.left_out]
    try:
        calibration = fit(
            config, frames, lambda n, rms_K: progress(f"fit, prediction {n}: {rms_K:.3f} K rms")
        )
    except LogError as error:
        raise LogError("; ".join([str(error), *left_out])) from None
    better, noise = calibration.kept is None, dict[str, float]()
    if better:
        noise = fit_noise(calibration.config, frames, lambda n: progress(f"process noise, trial {n} of 110"))
    result = calibration_result(calibration, noise) | {"doubts": runs.doubts, "kept": calibration.kept}
    result["left_out"] = left_out
    result["nut_path"] = {log.path.name: nut_paths(config, log) for log in logs}
    result = provenance(source, [log.path.name for log in logs]) | result
    return result, write_back(text_of(source), calibration.written | noise) if better else None
