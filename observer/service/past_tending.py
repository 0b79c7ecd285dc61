"""Upkeep of the files of the past, beside the loop: closed hours are packed, lost steps are made again.

Steps are lost where a service was killed before it had written them, or where it wrote none. The readings
give them again, to the same bits, from the state beside their recording.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from observer.errors import UserError
from observer.estimate.checkpoint import CheckpointFit
from observer.estimate.pipeline import MachineModel, Pipeline
from observer.estimate.replay import estimates_of, start_of
from observer.files.logs import read_log
from observer.installation import parse
from observer.record.retention import CONFIG_SUFFIX, is_being_written, recorded_config, recordings
from observer.record.step_columns import StepSource
from observer.record.step_files import StepAppender, pack_closed
from observer.record.step_store import Past

_LINE_BYTES = 1 << 16
_LOST_PERIODS = 1.5
_PERIOD_S = 0.05
"""A recording whose last step is stored so shortly before its end has lost none."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording that nobody writes any more.

    Attributes:
        path: The CSV file.
        from_s: Time of its first row, s since 1970.
        to_s: Time of its last whole row.
    """

    path: Path
    from_s: float
    to_s: float

    @classmethod
    def of(cls, path: Path) -> Recorded | None:
        """Return the times of a file; None if its first or last whole row has no time, or the file is
        gone.

        Only the first two lines and the last 64 kB are read.

        Raises:
            OSError: The file cannot be read.
        """
        with suppress(ValueError, FileNotFoundError), path.open("rb") as file:
            lines = [file.readline(_LINE_BYTES), file.readline(_LINE_BYTES)]
            file.seek(max(0, path.stat().st_size - _LINE_BYTES))
            lines += file.read(_LINE_BYTES).split(b"\n")[:-1]
            return cls(path, *(float(line.split(b",", 1)[0]) for line in (lines[1], lines[-1])))
        return None


def tend(folder: Path, name: str) -> None:
    """Pack closed hours, and make the steps again that the recordings have and the past has not.

    Without pyarrow the hours stay as they were written. A recording that cannot be replayed gives no steps.

    Args:
        folder: The service's `record.directory`.
        name: `<machine>-<axis>`.

    Raises:
        OSError: A file cannot be read or written.
        LogError: The folder cannot be read.
    """
    with suppress(ModuleNotFoundError):
        pack_closed(folder, name)
    past, has_rebuilt = Past(folder, name), False
    closed = [Recorded.of(f.path) for f in recordings(folder, name) if not is_being_written(f.path)]
    before = None
    for recorded in sorted((file for file in closed if file is not None), key=lambda file: file.from_s):
        stored_s = past.newest_s(recorded.from_s, recorded.to_s + _PERIOD_S)
        if recorded.to_s - stored_s > _PERIOD_S:
            with suppress(UserError):  # a recording that cannot be replayed gives no steps
                has_rebuilt |= rebuild(past, recorded, stored_s, before)
        before = recorded
    if has_rebuilt:
        with suppress(ModuleNotFoundError):
            pack_closed(folder, name)


def rebuild(past: Past, recorded: Recorded, after_s: float, before: Recorded | None) -> bool:
    """Write the steps of a recording after a time, by a replay from the state beside it.

    Args:
        past: Where the steps go.
        recorded: A recording; without the configuration beside it no step is made.
        after_s: Time of the last step that is stored.
        before: The recording that precedes it; None for the first. If it belongs to the same run of the
            service and the state is missing, the steps get a note that they differ from those published.

    Returns:
        Whether any step was written.

    Raises:
        UserError: The recording cannot be replayed, or its configuration is damaged.
        OSError: The disk refuses the steps.
    """
    document = recorded_config(recorded.path)
    if "config" not in document:
        return False
    config = parse(document["config"], recorded.path.stem + CONFIG_SUFFIX)
    if recorded.to_s - after_s < _LOST_PERIODS * config.estimator.period_s:
        return False
    machine = MachineModel.of(config, learns=True)
    pipeline = Pipeline(
        machine.drive, machine.estimator(), machine.self_test(), occasional=machine.occasional
    )
    log = read_log(recorded.path, machine.plan.channels, accept_truncated=True)
    start, words = start_of(log, CheckpointFit.of(machine))
    continues = before is not None and recorded_config(before.path).get("instance") == document["instance"]
    is_as_published = start is not None or (words == "cold" and not continues)
    note = "" if is_as_published else f"{recorded.path.name}: made again, started {words}"
    config_document = {key: value for key, value in document.items() if key != "checksum"}
    source = StepSource(machine.layout, machine.plan.channels, config_document, note)
    files = StepAppender(past.folder, past.name, source)
    sequence, has_written = 0 if start is None else start.sequence, False
    try:
        for frames, block in estimates_of(log, machine.plan, pipeline, lambda *_: None, start):
            rows = source.rows(frames, block, sequence)
            sequence += len(rows)
            rows = rows[np.searchsorted(rows["time_s"], after_s, side="right") :]
            while len(rows):
                rows = rows[files.append(rows) :]
                has_written = True
    finally:
        files.close()
    return has_written
