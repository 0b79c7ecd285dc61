"""Converts files from other recorders to logs of our own form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import ValidationError

from observer.errors import LogError
from observer.files.logs import suffix_of
from observer.files.writer import write_log
from observer.installation import Installation
from observer.intake.importing import Proposal, column_option, proposed
from observer.tables.logs import Logs


def import_log(
    paths: Sequence[Path],
    config: Installation,
    output: Path,
    agree: Callable[[Proposal], bool] | None,
    *,
    columns: Sequence[str] = (),
    time: str | None = None,
    time_format: str | None = None,
    timezone: str | None = None,
) -> Proposal:
    """Write files as one log, by `[log]`, the options and guesses; return the result.

    `agree` is asked once where something is doubtful; without it that is an error, which names the keys of
    `[log]` that settle it. Raises `LogError`.
    """
    suffix_of(output)
    given = config.log.model_dump(exclude_unset=True)
    clock = {"time": time, "time_format": time_format, "timezone": timezone}
    given |= {key: value for key, value in clock.items() if value}
    given["columns"] = config.log.columns | dict(map(column_option, columns))
    if unknown := [name for name in given["columns"] if name not in config.channels]:
        known = ", ".join(config.channels)
        raise LogError(f"--column: the model reads no channel {unknown[0]}; it reads {known}")
    try:
        how = Logs.model_validate(given)
    except ValidationError as error:
        wrong = error.errors()[0]
        option = "--" + str(wrong["loc"][0]).replace("_", "-")
        raise LogError(f"{option}: {wrong['msg'].removeprefix('Value error, ')}") from error
    found = proposed(paths, config, how)
    if found.asked and (agree is None or not agree(found)):
        said = [f"  {key}: {doubt}" for key, doubt in found.asked.items()]
        first = f"{output}: not written, because this is doubtful; clarify it in the configuration:"
        raise LogError("\n".join([first, *said, "the guess was", found.table]))
    log = found.log
    write_log(output, log.time_s, {name: log.values[:, i] for i, name in enumerate(log.channels)})
    return found
