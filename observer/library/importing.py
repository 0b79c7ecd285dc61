"""Logs of files that other recorders wrote, and extracts of such files for support."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from observer.config.logs import LogColumn, Logs
from observer.errors import LogError
from observer.intake.importing import ImportedLog, proposed
from observer.library.machine import Machine, load
from observer.library.packages import in_words

GivenFiles = str | Path | Sequence[str | Path]


@in_words
def import_log(
    files: GivenFiles,
    machine: Machine | str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    time: str | None = None,
    time_format: str | None = None,
    timezone: str | None = None,
) -> ImportedLog:
    """Read one or more files of one run as a log of a machine, by its `[log]`, the options and guesses.

    Args:
        files: One file or several, which are joined in the order of their times.
        machine: A machine, or the path of its configuration.
        columns: The file's column by channel, as `"Temp1"` or, with a unit, `"Temp1@degF"`; these replace
            `[log.columns]`.
        time: The name of the column with the times.
        time_format: Its format, as of `strptime`.
        timezone: Its IANA time zone, for local times.

    Returns:
        The log with the `[log]` table that reads it. `asked` has the doubts about guesses, and `.write(path)`
            writes the log.

    Raises:
        LogError: A file cannot be read, an option is invalid, or something cannot be guessed; all of it at
            once.
        ConfigError: The configuration is invalid.
    """
    config = (machine if isinstance(machine, Machine) else load(machine)).config
    options = {"time": time, "time_format": time_format, "timezone": timezone}
    keys = config.log.model_dump(exclude_unset=True) | {key: text for key, text in options.items() if text}
    keys["columns"] = config.log.columns | {name: _column(text) for name, text in (columns or {}).items()}
    if unknown := [name for name in keys["columns"] if name not in config.channels]:
        channels = ", ".join(config.channels)
        raise LogError(f"--column: the model reads no channel {unknown[0]}; name one of {channels}")
    try:
        settings = Logs.model_validate(keys)
    except ValidationError as error:
        problem = error.errors()[0]
        option = "--" + str(problem["loc"][0]).replace("_", "-")
        raise LogError(f"{option}: {problem['msg'].removeprefix('Value error, ')}") from error
    return proposed(_paths(files), config, settings)


def _column(text: str) -> LogColumn:
    name, mark, unit = text.strip().rpartition("@")
    return LogColumn(column=name, unit=unit) if mark else LogColumn(column=text.strip())


def _paths(files: GivenFiles) -> list[Path]:
    return [Path(file) for file in ([files] if isinstance(files, str | Path) else files)]


@in_words
def extract_log(files: GivenFiles, output: str | Path, machine: Machine | str | Path | None = None) -> int:
    """Write an extract of files to send to support, which shows how they are read.

    It has the first and last lines of each file, the guesses made from them, and less than 20 kB.

    Args:
        files: One file or several.
        output: The text file to write.
        machine: Read the files by the `[log]` of this machine; None for guesses only.

    Returns:
        The size in bytes.

    Raises:
        LogError: A file cannot be read, or the extract cannot be written.
    """
    from observer.intake.extract import extract_of

    if machine is not None and not isinstance(machine, Machine):
        machine = load(machine)
    text = extract_of(_paths(files), Logs() if machine is None else machine.config.log)
    data = text.encode("utf-8", "replace")
    try:
        Path(output).write_bytes(data)
    except OSError as error:
        raise LogError(f"{output}: cannot be written ({error.strerror}); choose another place") from None
    return len(data)
