"""Puts a found configuration in place of the one in force, with a way back; a record lies beside it.

Beside `machine.toml` lie then `machine.toml.before-adopt`, the configuration that it has replaced, and
`machine.toml.adopted.json`, which shows a running service that there is something to read and to monitor.
"""

from __future__ import annotations

import hashlib
import json
import math
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
Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]
State = Literal["watching", "kept", "taken_back", "undone", "replaced"]


class Adoption(BaseModel):
    """The outcome of an adopted configuration.

    `sha256` is that of the file's text, `hash` that of its meaning, as Zenoh's `config` gives it. Of the
    `watched_h` hours in which the machine ran so far, `hours` are wanted; the sums of the squares of both
    open-loop gaps over the same `values` readings are in K².
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    adopted_s: Amount
    state: State
    before: str
    before_sha256: str
    before_hash: str
    sha256: str
    hash: str
    hours: Amount
    watched_h: Amount = 0.0
    values: Annotated[int, Field(ge=0)] = 0
    before_squares_K2: Amount = 0.0
    squares_K2: Amount = 0.0
    reason: str = ""

    @property
    def before_rms_K(self) -> float | None:
        """The gap of the previous configuration over the hours watched."""
        return math.sqrt(self.before_squares_K2 / self.values) if self.values else None

    @property
    def rms_K(self) -> float | None:
        """The gap of the adopted one over the very same hours."""
        return math.sqrt(self.squares_K2 / self.values) if self.values else None

    def document(self) -> dict[str, Any]:
        """What health reports of it."""
        return {
            "state": self.state,
            "since_s": self.adopted_s,
            "watched_h": round(self.watched_h, 3),
            "hours": self.hours,
            "before_rms_K": _rounded(self.before_rms_K),
            "rms_K": _rounded(self.rms_K),
            "reason": self.reason or None,
        }

    def sentence(self) -> str:
        """The same for people."""
        said = f"adopted {datetime.fromtimestamp(self.adopted_s, UTC):%Y-%m-%d %H:%M} UTC: "
        said += {
            "watching": f"watched for {self.watched_h:.3g} of {self.hours:g} h of running",
            "taken_back": "reverted",
            "replaced": "since replaced by another configuration, which is left as it is",
        }.get(self.state, self.state.replace("_", " "))
        if self.rms_K is not None and self.before_rms_K is not None:
            said += f"; open-loop gap {self.before_rms_K:.3g} K rms before, {self.rms_K:.3g} K now"
        return said + (f" ({self.reason})" if self.reason else "")


def adoption_of(config: Path) -> Adoption | None:
    """The last adoption in place of a configuration, None without one.

    Raises `ConfigError` where the record cannot be read or is invalid.
    """
    path = _beside(config, RECORD)
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


def note(config: Path, adoption: Adoption) -> None:
    """Write the outcome of an adoption beside its configuration. Raises `UserError`."""
    _write({_beside(config, RECORD): _text(adoption)}, config)


def adopt(folder: Path, config: Path, hours: float, now_s: float, *, candidate: bool = False) -> Adoption:
    """Put the configuration written by a search in place of the one it has searched.

    The `candidate` of an unknown is put there only on demand.

    Raises `UserError` where there is none, where the configuration is not the one that was searched any more,
    where the new one cannot be loaded or is of another machine, or where the files cannot be written.
    """
    config = config.resolve()
    before, watched = load(config), adoption_of(config)
    if watched is not None and watched.state == "watching" and watched.sha256 == sha256(config):
        raise UserError(f"{config}: {watched.sentence()}; wait for its end, or undo it with --undo")
    path = _found(folder, config, candidate=candidate)
    new = load(path)
    refuse_unlike(before, new, path)
    text, kept = path.read_bytes(), _free(config)
    adoption = Adoption(
        adopted_s=now_s, state="watching", before=kept.name, before_sha256=sha256(config),
        before_hash=before.digest, sha256=hashlib.sha256(text).hexdigest(), hash=new.digest, hours=hours,
    )  # fmt: skip
    _write({kept: config.read_bytes(), config: text, _beside(config, RECORD): _text(adoption)}, config)
    return adoption


def take_back(config: Path, adoption: Adoption, state: State, reason: str = "") -> Adoption:
    """Restore the configuration from before an adoption; returns the record then.

    Raises `UserError` where somebody has changed the configuration since, which is left as it is then, or
    where a file is missing or cannot be written.
    """
    config = config.resolve()
    if sha256(config) != adoption.sha256:
        raise UserError(
            f"{config}: has been changed since it was adopted, and is left as it is; the previous one is in "
            f"{before_of(config, adoption)}"
        )
    before = before_of(config, adoption)
    if sha256(before) != adoption.before_sha256:
        raise UserError(f"{before}: is no longer the configuration that was in force; restore it by hand")
    ended = adoption.model_copy(update={"state": state, "reason": reason})
    _write({config: before.read_bytes(), _beside(config, RECORD): _text(ended)}, config)
    return ended


def before_of(config: Path, adoption: Adoption) -> Path:
    """The path of the configuration that an adopted one has replaced."""
    return config.with_name(Path(adoption.before).name)


def undo(config: Path) -> Adoption:
    """Revert an adopted configuration on request. Raises `UserError`."""
    adoption = adoption_of(config.resolve())
    if adoption is None:
        raise UserError(f"{config}: nothing was adopted in its place, so there is nothing to undo")
    if adoption.state in {"taken_back", "undone"}:
        raise UserError(f"{config}: {adoption.sentence()}; there is nothing to undo")
    return take_back(config, adoption, "undone")


def refuse_unlike(before: Installation, new: Installation, place: Path) -> None:
    """Raise `ConfigError` where a configuration is not of the same machine and drivers."""
    for key, was, now in (
        ("machine.name", before.machine.name, new.machine.name),
        ("machine.axis", before.machine.axis, new.machine.axis),
        ("channels", sorted(before.channels), sorted(new.channels)),
        ("sensors", [s.name for s in before.sensor], [s.name for s in new.sensor]),
    ):
        if was != now:
            raise ConfigError(
                f"{place}: {key} is {now} where the one in force has {was}; adopt one of its own"
            )
    if (problems := new.undelivered()) and not before.undelivered():
        raise ConfigError(f"{place}: {problems[0]}")


def sha256(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal digits; raises `ConfigError` where it cannot be read."""
    try:
        return hashlib.sha256(read_regular(path, MOST_BYTES, "a configuration")).hexdigest()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); put it back") from None


def _found(folder: Path, config: Path, *, candidate: bool) -> Path:
    """The configuration in a folder of results, if it was found for this one."""
    result = _result(folder)
    path = folder / ("candidate.toml" if candidate else "config.toml")
    offered = _table(result.get("partial")).get("candidate") is not None
    if offered and not candidate:
        raise ConfigError(
            f"{folder}: holds only a candidate (candidate.toml): it explains part of what is missing, but "
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
    """The result of a search; the newer one, where two were written into a folder."""
    there = [folder / name for name in RESULTS if (folder / name).is_file()]
    if not there:
        raise ConfigError(
            f"{folder}: holds no {' or '.join(RESULTS)}; name a folder that `observer discover` or "
            "`observer calibrate` has written"
        )
    newest = max(there, key=lambda path: path.stat().st_mtime_ns)
    try:
        document = json.loads(newest.read_bytes())
    except (OSError, ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise ConfigError(f"{newest}: is damaged; search again")
    return document


def _beside(config: Path, suffix: str) -> Path:
    return config.resolve().with_name(config.resolve().name + suffix)


def _free(config: Path) -> Path:
    """An unused name for the previous configuration: nothing is lost by adopting twice."""
    path, number = _beside(config, BEFORE), 1
    while path.exists():
        number += 1
        path = _beside(config, f"{BEFORE}-{number}")
    return path


def _text(adoption: Adoption) -> bytes:
    return adoption.model_dump_json(indent=2).encode() + b"\n"


def _write(files: Mapping[Path, bytes], like: Path) -> None:
    """Write all or none; the record comes last, since it shows the service that all the rest is there."""
    try:
        write_together(files, like)
    except OSError as error:
        place = error.filename or like.parent
        raise UserError(
            f"{like}: nothing is changed, since {place} cannot be written ({error.strerror}); let this user "
            "write there, or free space"
        ) from None


def _rounded(value_K: float | None) -> float | None:
    return None if value_K is None else round(value_K, 4)
