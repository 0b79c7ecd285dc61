"""Commands that take a log as it is: replay, forecast, heats, open-loop prediction, and what other recorders
wrote made a log; results as files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from observer.errors import LogError
from observer.files.logs import suffix_of
from observer.installation import Installation

if TYPE_CHECKING:
    from observer.intake.importing import Proposal


def extract_log(paths: Sequence[Path], config: Installation | None, output: Path) -> int:
    """Write an extract of files to send to support; return its size in bytes. Raises `LogError`."""
    from observer.intake.extract import extract_of
    from observer.tables.logs import Logs

    data = extract_of(paths, Logs() if config is None else config.log).encode("utf-8", "replace")
    try:
        output.write_bytes(data)
    except OSError as error:
        raise LogError(f"{output}: cannot be written ({error.strerror}); choose another place") from None
    return len(data)


class ImportOptions(NamedTuple):
    """The options of an import that override `[log]`: columns as `CHANNEL=COLUMN`, and the clock."""

    columns: Sequence[str] = ()
    time: str | None = None
    time_format: str | None = None
    timezone: str | None = None


def import_log(
    paths: Sequence[Path],
    config: Installation,
    output: Path,
    agree: Callable[[Proposal], bool] | None,
    options: ImportOptions = ImportOptions(),  # noqa: B008 (it is frozen)
) -> Proposal:
    """Write files as one log, by `[log]`, the options and guesses; return the result.

    `agree` is asked once where something is doubtful; without it that is an error, which names the keys of
    `[log]` that settle it. Raises `LogError`.
    """
    from pydantic import ValidationError

    from observer.files.writer import write_log
    from observer.intake.importing import column_option, proposed
    from observer.tables.logs import Logs

    suffix_of(output)
    given = config.log.model_dump(exclude_unset=True)
    clock = {key: value for key, value in options._asdict().items() if key != "columns" and value}
    given |= clock
    given["columns"] = config.log.columns | dict(map(column_option, options.columns))
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
    write_log(
        output, log.time_s, {name: log.values[:, i] for i, name in enumerate(log.channels)}, found.doubts
    )
    return found
