"""The search for a model's missing physics: its result, and the configurations and the report that follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.config.machine import Config
from observer.discovery.discover import Discovery
from observer.discovery.discover import discover as find
from observer.discovery.result import CANDIDATE, TEST_CYCLE, calibrated_of, discovery_result
from observer.discovery.suspects import Suspect
from observer.discovery.workers import WorkerPool
from observer.files.documents import write_json
from observer.files.writer import write_log
from observer.frames import FrameBlock
from observer.installation import Installation, with_effects, write_back
from observer.library.fitting import RunsOfLogs, provenance, text_of
from observer.report.advice import candidate_comment, next_step


@dataclass(frozen=True, slots=True)
class SearchedLogs:
    """The result of a search.

    Attributes:
        discovery: The search itself: verdict, problem, proposed experiment.
        document: The content of `result.json` without the next command.
        texts: The configurations by the names of their files; empty if nothing was named.
    """

    discovery: Discovery
    document: dict[str, Any]
    texts: dict[str, str]

    def write(self, folder: Path, logs: str, config: str, output: str, *, report: bool) -> dict[str, Any]:
        """Write all files of the result into a folder.

        Args:
            folder: An existing folder.
            logs: The logs as in a shell, or `--recent …`; for the next command.
            config: The configuration's path, for the next command.
            output: The final folder's path, for the next command.
            report: Draw `report.html`, which takes some seconds.

        Returns:
            The content of `result.json`, with the next command.
        """
        from observer.report.discovery import write_discovery_report

        result = self.document | {"next": next_step(self.document, logs, config, output)}
        for name, text in self.texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        test = self.discovery.experiment
        if test is not None and result["experiment"]["program"] is not None:
            write_program(folder / TEST_CYCLE, self.discovery.problem.config, test.cycle)
        write_json(folder / "result.json", result)
        if report:
            write_discovery_report(folder / "report.html", self.discovery, result, result["logs"])
        return result


def searched(
    config: Installation,
    source: bytes,
    runs: RunsOfLogs,
    names: Sequence[str],
    progress: Callable[[str, float], None],
    *,
    in_process: bool,
) -> SearchedLogs:
    """Find the effect that a model lacks.

    Args:
        config: The machine.
        source: The bytes of its file.
        runs: The runs of the logs.
        names: The names of the logs, for the result.
        progress: Receives the stage of the work and the share done, 0 to 1.
        in_process: Keep all work in this process; the result is the same.

    Raises:
        ConfigError: The configuration declares no parameter free.
        LogError: The logs are too short, or hold nothing to compare.
    """
    corrected = [Suspect("units", m.channel, m.unit, m.text) for m in runs.misread]
    with WorkerPool(in_process=in_process) as pool:
        discovery = find(config, runs.frames, progress, pool, corrected)
    document = provenance(source, names) | discovery_result(discovery) | {"doubts": runs.doubts}
    return SearchedLogs(discovery, document, configurations(text_of(source), discovery, document))


def write_program(path: Path, config: Config, cycle: FrameBlock) -> None:
    """Write the inputs of a cycle as a log, for the machine or for `observer simulate --program`.

    Args:
        path: The file; its suffix chooses the format.
        config: Its sources' channels are the columns.
        cycle: Frames (K, c). Values are rounded to five decimals.
    """
    sources = config.source
    channels = [
        c for s in sources for c in (s.position_channel, s.speed_channel, s.drive_channel, s.power_channel)
    ]
    driven = [c for c in cycle.channels if c in channels]
    columns = {c: cycle.values[:, cycle.channels.index(c)] for c in driven}
    write_log(path, cycle.time_s, {c: np.round(values, 5) for c, values in columns.items()})


def configurations(config_text: str, discovery: Discovery, result: dict[str, Any]) -> dict[str, str]:
    """Return the improved configuration, by the name of its file.

    Args:
        config_text: The configuration in use; its comments stay.
        discovery: The search.
        result: The content of `result.json`.

    Returns:
        `config.toml` with the named effects, or `candidate.toml` with the effect that explains most of an
            unknown gap; empty for neither.
    """
    partial = result["partial"]
    if discovery.verdict.kind == "named":
        name, fit, comment = "config.toml", discovery.verdict.fit, ""
    elif discovery.partial is not None and partial is not None:
        name, fit = CANDIDATE, discovery.partial.trial.fit
        comment = candidate_comment(partial)
    else:
        return {}
    values = {key: entry["value"] for key, entry in calibrated_of(fit).items()}
    if name == "config.toml" and discovery.displacements is not None:
        values |= discovery.displacements.values
    text = with_effects(
        write_back(config_text, values), fit.config.effect[len(discovery.problem.config.effect) :]
    )
    return {name: comment + text}
