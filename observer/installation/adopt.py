"""Puts a found configuration in place of the one in force, with a way back.

Beside `machine.toml` lie then `machine.toml.before-adopt`, the configuration that it has replaced, and
`machine.toml.adopted.json`, the record of the adoption; a running service reloads when the record changes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from observer.errors import ConfigError, UserError
from observer.files.folders import write_together
from observer.files.regular import MOST_BYTES, read_regular
from observer.installation import Installation, load

RECORD, BEFORE = ".adopted.json", ".before-adopt"
RESULTS = ("result.json", "calibration.json", "learned.json")


class Adoption(BaseModel):
    """The record of an adopted configuration.

    Attributes:
        adopted_s: When it was adopted, s since 1970.
        state: `undone` once the previous configuration is back.
        before: Name of the file, beside the configuration, with the one that was replaced.
        before_sha256: Digest of that file.
        sha256: Digest of the adopted configuration.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    adopted_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    state: Literal["adopted", "undone"]
    before: str
    before_sha256: str
    sha256: str

    def sentence(self) -> str:
        """Return when it was adopted, in UTC, and whether it is undone."""
        text = f"adopted {datetime.fromtimestamp(self.adopted_s, UTC):%Y-%m-%d %H:%M} UTC"
        return f"{text}, undone since" if self.state == "undone" else text


def adoption_of(config: Path) -> Adoption | None:
    """Return the record of the last adoption in place of a configuration; None without one.

    Raises:
        ConfigError: The record cannot be read, or is invalid.
    """
    path = record_of(config)
    try:
        return Adoption.model_validate_json(read_regular(path, MOST_BYTES, "the record of an adoption"))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); let this user read it") from None
    except ValidationError:
        raise ConfigError(
            f"{path}: is not what `observer adopt` has written; remove it, the configuration stays as it is"
        ) from None


def adopt(folder: Path, config: Path, now_s: float, *, candidate: bool = False) -> Adoption:
    """Replace a configuration by the one that a search or a calibration wrote into a folder.

    The previous one is kept beside it. All files change or none, the record last, which a running service
    sees.

    Args:
        folder: The folder with `result.json`, `calibration.json` or `learned.json`.
        config: The configuration in force; a link is followed.
        now_s: Time of the adoption, s since 1970.
        candidate: Take `candidate.toml`, which explains part of an unknown gap.

    Raises:
        ConfigError: The folder has no such configuration, `config` has changed since the search, or the new
            one is invalid or of another machine.
        UserError: A file cannot be written.
    """
    config = config.resolve()
    path = _adoptable(folder, config, candidate=candidate)
    refuse_unlike(load(config), load(path), path)
    text, backup = path.read_bytes(), _free(config)
    adoption = Adoption(
        adopted_s=now_s, state="adopted", before=backup.name, before_sha256=sha256(config),
        sha256=hashlib.sha256(text).hexdigest(),
    )  # fmt: skip
    _write({backup: config.read_bytes(), config: text, record_of(config): _text(adoption)}, config)
    return adoption


def undo(config: Path) -> Adoption:
    """Restore the configuration from before the last adoption, and return the new record.

    Raises:
        UserError: Nothing was adopted, it is undone already, the configuration has changed since, or a file
            is missing or cannot be written. The configuration is kept then.
    """
    config = config.resolve()
    adoption = adoption_of(config)
    if adoption is None:
        raise UserError(
            f"{config}: nothing was adopted in its place; name a configuration that `observer adopt` replaced"
        )
    if adoption.state == "undone":
        raise UserError(f"{config}: {adoption.sentence()}; to have it again, adopt its folder again")
    before = before_of(config, adoption)
    if sha256(config) != adoption.sha256:
        raise UserError(
            f"{config}: has been changed since it was adopted; to give the changes up, copy {before} over it"
        )
    if sha256(before) != adoption.before_sha256:
        raise UserError(f"{before}: is no longer the configuration that was in force; restore it by hand")
    undone = adoption.model_copy(update={"state": "undone"})
    _write({config: before.read_bytes(), record_of(config): _text(undone)}, config)
    return undone


def before_of(config: Path, adoption: Adoption) -> Path:
    """Return the path of the configuration that an adopted one has replaced, beside it."""
    return config.with_name(Path(adoption.before).name)


def record_of(config: Path) -> Path:
    """Return the path of the record of the last adoption, beside the configuration that a link points to."""
    return _sibling(config, RECORD)


def refuse_unlike(before: Installation, new: Installation, place: Path) -> None:
    """Refuse a configuration of another machine.

    Args:
        before: The configuration in force.
        new: The one to adopt.
        place: Its file, named in the error.

    Raises:
        ConfigError: Name, axis, channels or sensors differ, or channels are no longer delivered.
    """
    for key, was, now in (
        ("machine.name", before.machine.name, new.machine.name),
        ("machine.axis", before.machine.axis, new.machine.axis),
        ("channels", sorted(before.channels), sorted(new.channels)),
        ("sensors", [s.name for s in before.sensor], [s.name for s in new.sensor]),
    ):
        if was != now:
            raise ConfigError(
                f"{place}: {key} is {now} where the one in force has {was}; adopt one of this machine"
            )
    if (problems := new.undelivered()) and not before.undelivered():
        raise ConfigError(f"{place}: {problems[0]}")


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits.

    Raises:
        ConfigError: The file cannot be read.
    """
    try:
        return hashlib.sha256(read_regular(path, MOST_BYTES, "a configuration")).hexdigest()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); put it back") from None


def _adoptable(folder: Path, config: Path, *, candidate: bool) -> Path:
    """Return the path of the configuration to adopt in a folder of results.

    Raises `ConfigError` without one, or where another configuration was searched.
    """
    result = _result(folder)
    path = folder / ("candidate.toml" if candidate else "config.toml")
    offered = _table(result.get("partial")).get("candidate") is not None
    if offered and not candidate:
        raise ConfigError(
            f"{folder}: holds only a candidate (candidate.toml): it explains part of the deviation, but "
            "the search could not name it; read report.html, and add --candidate if you can say what it is"
        )
    if candidate and not offered:
        raise ConfigError(f"{folder}: holds no candidate; leave --candidate out")
    if not path.is_file() or (not candidate and result.get("verdict", "named") != "named"):
        raise ConfigError(
            f"{folder}: holds no configuration to adopt (config.toml); `observer discover` writes one only "
            "where it has named an effect, `observer calibrate` only where the fitted values are better"
        )
    searched = result.get("config_sha256")
    if searched is None:
        raise ConfigError(
            f"{folder}: does not say which configuration was searched (config_sha256); search again"
        )
    if searched != sha256(config):
        raise ConfigError(
            f"{folder}: {config} is no longer the configuration that was searched; search again with the one "
            "in force"
        )
    return path


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _result(folder: Path) -> Mapping[str, Any]:
    """Return the content of the newest result in a folder. Raises `ConfigError` without a valid one."""
    result_files = [folder / name for name in RESULTS if (folder / name).is_file()]
    if not result_files:
        raise ConfigError(
            f"{folder}: holds no {' or '.join(RESULTS)}; name a folder that `observer discover` or "
            "`observer calibrate` has written"
        )
    newest = max(result_files, key=lambda path: path.stat().st_mtime_ns)
    try:
        document = json.loads(newest.read_bytes())
    except (OSError, ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise ConfigError(f"{newest}: is damaged; search again")
    return document


def _sibling(config: Path, suffix: str) -> Path:
    return config.resolve().with_name(config.resolve().name + suffix)


def _free(config: Path) -> Path:
    """Return an unused name for the copy of the previous configuration."""
    path, number = _sibling(config, BEFORE), 1
    while path.exists():
        number += 1
        path = _sibling(config, f"{BEFORE}-{number}")
    return path


def _text(adoption: Adoption) -> bytes:
    return adoption.model_dump_json(indent=2).encode() + b"\n"


def _write(files: Mapping[Path, bytes], config: Path) -> None:
    """Write all or none; the record comes last, since it shows the service that all the rest is there."""
    try:
        write_together(files, config)
    except OSError as error:
        place = error.filename or config.parent
        raise UserError(
            f"{config}: nothing is changed, since {place} cannot be written ({error.strerror}); let this "
            "user write there, or free space"
        ) from None
