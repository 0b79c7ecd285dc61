"""The search for a model's missing physics: its result, and the configurations and the report that follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from observer.config import Config
from observer.discovery.discover import Discovery
from observer.discovery.discover import discover as find
from observer.discovery.result import CANDIDATE, TEST_CYCLE, calibrated_of, discovery_result
from observer.discovery.suspects import Suspect
from observer.discovery.workers import WorkerPool
from observer.files.documents import write_json
from observer.files.writer import write_log
from observer.frames import FrameBlock
from observer.installation import Installation, with_effects, write_back
from observer.library.fitting import RunsOfLogs, about, text_of
from observer.report.advice import candidate_comment, next_step


@dataclass(frozen=True, slots=True)
class SearchedLogs:
    """The result of a search: the content of `result.json` without the next step, and the configurations by
    the names of their files.
    """

    found: Discovery
    document: dict[str, Any]
    texts: dict[str, str]

    def write(self, folder: Path, logs: str, config: str, output: str, *, report: bool) -> dict[str, Any]:
        """Write what there is into a folder; return the content of `result.json`.

        `logs`, `config` and `output` are how a shell would name them, for the next command.
        """
        from observer.report.discovery import write_discovery_report

        result = self.document | {"next": next_step(self.document, logs, config, output)}
        for name, text in self.texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        test = self.found.experiment
        if test is not None and result["experiment"]["program"] is not None:
            write_program(folder / TEST_CYCLE, self.found.problem.config, test.cycle)
        write_json(folder / "result.json", result)
        if report:
            write_discovery_report(folder / "report.html", self.found, result, result["logs"])
        return result


def searched(
    config: Installation,
    source: bytes,
    runs: RunsOfLogs,
    names: Sequence[str],
    progress: Callable[[str, float], None],
    *,
    alone: bool,
) -> SearchedLogs:
    """Find the effect that a model lacks, in runs of which the logs are called `names`.

    `alone`, in this process only. Raises `ConfigError` or `LogError`.
    """
    corrected = [Suspect("units", m.channel, m.unit, m.text) for m in runs.misread]
    with WorkerPool(in_process=alone) as pool:
        found = find(config, runs.frames, progress, pool, corrected)
    document = about(source, names) | discovery_result(found) | {"doubts": runs.odd}
    return SearchedLogs(found, document, configurations(text_of(source), found, document))


def write_program(path: Path, config: Config, cycle: FrameBlock) -> None:
    """Write what drives the sources over a cycle, for the machine or for `observer simulate --program`."""
    sources = config.source
    channels = [
        c for s in sources for c in (s.position_channel, s.speed_channel, s.drive_channel, s.power_channel)
    ]
    driven = [c for c in cycle.channels if c in channels]
    columns = {c: cycle.values[:, cycle.channels.index(c)] for c in driven}
    write_log(path, cycle.time_s, {c: np.round(values, 5) for c, values in columns.items()})


def configurations(given: str, found: Discovery, result: dict[str, Any]) -> dict[str, str]:
    """The named effects as `config.toml`, or the one that explains most of an unknown as `candidate.toml`, if
    any.
    """
    partial = result["partial"]
    if found.verdict.kind == "named":
        name, fit, comment = "config.toml", found.verdict.fit, ""
    elif found.partial is not None and partial is not None:
        name, fit = CANDIDATE, found.partial.trial.fit
        comment = candidate_comment(partial)
    else:
        return {}
    values = {key: entry["value"] for key, entry in calibrated_of(fit).items()}
    if name == "config.toml" and found.displacements is not None:
        values |= found.displacements.values
    text = with_effects(write_back(given, values), fit.config.effect[len(found.problem.config.effect) :])
    return {name: comment + text}
