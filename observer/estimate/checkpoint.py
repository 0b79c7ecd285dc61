"""The state of a service as bytes: drive, estimator and compensation after a step, to the last bit.

A checkpoint is a line with the format's name, the SHA-256 of the document, and a CBOR document. The document
contains only numbers, texts and arrays; it is never executed. A restart restores the fields that fit the
current parts. The same bytes, in a second file, begin a recording made after a warm start.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cbor2
import numpy as np
import structlog

from observer.align.walk import Memory, nothing_yet
from observer.control import compensation
from observer.control.compensation import CompensationState
from observer.estimate.pipeline import MachineModel
from observer.estimate.screw_state import ScrewState
from observer.estimators.protocol import EstimatorState
from observer.estimators.selftest import SelfTestState
from observer.quality.gap import GapState

_FORMAT = b"ballscrew-observer checkpoint 1\n"
_MOST_BYTES = 64_000_000
_MOMENTS = frozenset(
    {
        "time_s", "last_s", "begin_s", "held_since_s", "released_s", "first_out_s", "latched_s",
        "common_from_s", "held_from_s", "held_until_s",
    }
)  # fmt: skip
"""The fields that hold a moment of the service's time."""


log = structlog.get_logger()


class UnfitError(Exception):
    """A checkpoint cannot be resumed; the message gives the reason, to follow its name and a colon.

    A service starts cold then, so it is caught and logged.
    """


@dataclass(frozen=True, slots=True)
class Snapshot:
    """States of a pipeline after a step.

    A restart uses neither `walk`, `test` nor `sequence`; they are for a recording that continues another one.

    Attributes:
        tick_s: The time of the step.
        drive: The state of the drive.
        estimator: The state of the estimator.
        gap: The state of the open-loop residual; None without.
        compensation: The state of the compensation; None without.
        walk: The memory of the aligner; None without.
        test: The state of the self-test; None without.
        sequence: The number of the next estimate.
        screw: At the end of a process, what another model of the machine continues from; None without.
    """

    tick_s: float
    drive: Any
    estimator: EstimatorState
    gap: GapState | None = None
    compensation: CompensationState | None = None
    walk: Memory | None = None
    test: SelfTestState | None = None
    sequence: int = 0
    screw: ScrewState | None = None


@dataclass(frozen=True, slots=True)
class CheckpointFit:
    """Requirements on a checkpoint.

    Attributes:
        plant: The digest of the plant's part of the configuration.
        drive: The drive's state at a cold start, whose shapes must fit.
        estimator: The estimator's state at a cold start.
        setup: The digest of the compensation's table.
        compensation: The compensation's state at a cold start; None if it is not enabled.
        gap: The residual's state at a cold start; None without.
        walk: The aligner's memory at a cold start.
        test: The self-test's state at a cold start.
    """

    plant: str
    drive: Any
    estimator: EstimatorState
    setup: str = ""
    compensation: CompensationState | None = None
    gap: GapState | None = None
    walk: Memory | None = None
    test: SelfTestState | None = None

    @classmethod
    def of(cls, machine: MachineModel) -> CheckpointFit:
        """Return the requirements of a machine.

        Raises:
            UserError: If its estimator cannot be designed.
        """
        config, settings, gap = machine.config, machine.config.compensation, machine.gap()
        setup = hashlib.sha256(settings.model_dump_json().encode()).hexdigest()[:16]
        compensation_state = compensation.initial(compensation.plan_of(config)) if settings.enabled else None
        begin = machine.drive.initial(), machine.estimator().initial()
        memories = nothing_yet(machine.plan.expected()), machine.self_test().initial()
        return cls(
            config.plant_digest,
            *begin,
            setup,
            compensation_state,
            None if gap is None else gap.state,
            *memories,
        )


def pack(snapshot: Snapshot, fit: CheckpointFit) -> bytes:
    """Return a snapshot as bytes; `unpack` gives it back to the last bit.

    Args:
        snapshot: The states.
        fit: Gives the digests of plant and compensation.
    """
    compensation_entry = (
        {"setup": fit.setup, "state": _plain(snapshot.compensation)} if snapshot.compensation else None
    )
    body = cbor2.dumps(
        {
            "version": version("ballscrew-observer"),
            "plant": fit.plant,
            "tick_s": snapshot.tick_s,
            "drive": _plain(snapshot.drive),
            "estimator": _plain(snapshot.estimator),
            "compensation": compensation_entry,
            "gap": _plain(snapshot.gap),
            "walk": _plain(snapshot.walk),
            "test": _plain(snapshot.test),
            "sequence": snapshot.sequence,
            "screw": _plain(snapshot.screw),
        }
    )
    return _FORMAT + hashlib.sha256(body).digest() + body


def unpack(data: bytes, fit: CheckpointFit, machine: MachineModel | None = None) -> Snapshot:
    """Return a snapshot from bytes, which may come from anywhere.

    The compensation and the open-loop residual are left out if only they do not fit.

    Args:
        data: The content of a checkpoint.
        fit: The requirements.
        machine: With it, a snapshot of another plant continues in that machine, where both have enough in
            common; None rejects it.

    Raises:
        UnfitError: If it is damaged, or of another plant or version.
    """
    document = _document(data)
    if document.get("version") != version("ballscrew-observer"):
        raise UnfitError(f"it was written by version {document.get('version')} of the program")
    tick_s = _filled(0.0, document.get("tick_s"), "tick_s")
    if document.get("plant") != fit.plant:
        return _of_another_plant(document, fit, machine, tick_s)
    estimator = _filled(fit.estimator, document.get("estimator"), "estimator")
    if not all(np.isfinite(array).all() for array in (tick_s, estimator.x_hat, estimator.P)):
        raise UnfitError("it holds numbers that are not finite")
    return Snapshot(
        tick_s,
        _filled(fit.drive, document.get("drive"), "drive"),
        estimator,
        _gap(document.get("gap"), fit),
        _compensation(document.get("compensation"), fit),
        _remembered(fit.walk, document.get("walk"), "walk"),
        _remembered(fit.test, document.get("test"), "test"),
        _filled(0, document.get("sequence", 0), "sequence"),
    )


def _of_another_plant(
    document: Mapping[str, Any], fit: CheckpointFit, machine: MachineModel | None, tick_s: float
) -> Snapshot:
    """Return another plant's snapshot in the plant of a machine; raises `UnfitError` if it does not fit."""
    screw, continued = document.get("screw"), None
    if machine is not None and screw is not None and np.isfinite(tick_s):
        try:
            continued = _screw(screw).continued(machine, tick_s)
        except (ArithmeticError, LookupError, ValueError):  # no checkpoint prevents a start
            log.error("a checkpoint of another model cannot be used", exc_info=True)
    if continued is None:
        raise UnfitError("it was written under another configuration of the machine")
    drive, estimator = continued
    try:
        nuts = {name: _filled(getattr(fit.drive, name), document["drive"][name], name) for name in _PATHS}
        drive = replace(drive, **nuts)
    except (UnfitError, KeyError, TypeError):
        log.info("the paths of the nuts start again")
    log.info("field and heats are carried over into another model of the screw")
    return Snapshot(tick_s, drive, estimator, None, _compensation(document.get("compensation"), fit))


_PATHS = ("nuts", "turns")
"""The fields of a drive's state that contain the paths of nuts."""


def _screw(plain: Any) -> ScrewState:
    """Return the state of a screw of any size; raises `UnfitError` if the document lacks it."""

    def part(name: str) -> Any:
        if name in ("heats", "lags", "channels"):
            return tuple(map(str, plain[name]))
        dtype, shape, data = plain[name]
        return np.frombuffer(data, np.dtype(dtype)).reshape(shape).copy()

    try:
        return ScrewState(**{field.name: part(field.name) for field in fields(ScrewState)})
    except (LookupError, TypeError, ValueError):
        raise UnfitError("its screw does not fit any model") from None


def load(path: Path, fit: CheckpointFit, machine: MachineModel | None = None) -> Snapshot:
    """Return a snapshot from a file.

    Args:
        path: The checkpoint.
        fit: The requirements.
        machine: With it, a snapshot of another plant continues in that machine (see `unpack`); None rejects
            it.

    Raises:
        UnfitError: If the file is missing, unreadable or damaged, or does not fit.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        raise UnfitError("there is none yet") from None
    except OSError as error:
        raise UnfitError(f"it cannot be read ({error.strerror})") from None
    return unpack(data, fit, machine)


def recent(snapshot: Snapshot, now_s: float, oldest_s: float) -> Snapshot:
    """Return the same snapshot, if it is recent enough.

    Args:
        snapshot: The snapshot.
        now_s: The present time in s since 1970.
        oldest_s: The largest age in s; infinite for any.

    Raises:
        UnfitError: If it is older, or from the future.
    """
    age_s = now_s - snapshot.tick_s
    if age_s <= 0.0:
        raise UnfitError(f"it is {-age_s:.3g} s ahead of the computer's clock")
    if age_s > oldest_s:
        raise UnfitError(f"it is {age_s:.6g} s old, more than {oldest_s:g} s")
    return snapshot


def shifted(snapshot: Snapshot, by_s: float) -> Snapshot:
    """Return a snapshot with all its times shifted, for a computer whose clock was set.

    Args:
        snapshot: The snapshot; it is not changed.
        by_s: The step of the clock in s, forwards positive.
    """
    drive, estimator = _moved(snapshot.drive, by_s), _moved(snapshot.estimator, by_s)
    gap, compensation_state = _moved(snapshot.gap, by_s), _moved(snapshot.compensation, by_s)
    return replace(
        snapshot,
        tick_s=snapshot.tick_s + by_s,
        drive=drive,
        estimator=estimator,
        gap=gap,
        compensation=compensation_state,
    )


def _document(data: bytes) -> Mapping[str, Any]:
    head, body = data[: len(_FORMAT) + 32], data[len(_FORMAT) + 32 :]
    if not head.startswith(_FORMAT):
        raise UnfitError("it is not a checkpoint of this program")
    if hashlib.sha256(body).digest() != head[len(_FORMAT) :]:
        raise UnfitError("it is damaged (its checksum is wrong)")
    try:
        document = cbor2.loads(body)
    except (cbor2.CBORError, ValueError, OverflowError, RecursionError, MemoryError):
        document = None
    if not isinstance(document, dict):
        raise UnfitError("it is not a checkpoint of this program")
    return document


def _plain(value: Any) -> Any:
    """Return dataclasses, tuples, arrays and scalars as CBOR types; floats stay 64 bits wide."""
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    value = _by_name(value)
    if isinstance(value, np.ndarray):
        return [value.dtype.str, list(value.shape), value.tobytes()]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    return value


def _by_name(value: Any) -> Any:
    """Return an array of records as an array for each of their names, and any other value unchanged."""
    if isinstance(value, np.ndarray) and value.dtype.names:
        return {name: value[name] for name in value.dtype.names}
    return value


def _records(like: Any, parts: Mapping[str, Any]) -> Any:
    """Return records like some others, with these numbers by name."""
    records = np.empty_like(like)
    for name, part in parts.items():
        records[name] = part
    return records


def _filled(like: Any, plain: Any, name: str) -> Any:
    """Return the value encoded in `plain`; raises `UnfitError` if its type or shape differs from `like`."""
    if is_dataclass(like) and not isinstance(like, type):
        names = [field.name for field in fields(like)]
        if isinstance(plain, dict) and set(plain) == set(names):
            return replace(like, **{n: _filled(getattr(like, n), plain[n], f"{name}.{n}") for n in names})
    elif isinstance(like, np.ndarray) and like.dtype.names:
        return _records(like, _filled(_by_name(like), plain, name))
    elif isinstance(like, np.ndarray):
        match plain:
            case [like.dtype.str, [*shape], bytes(data)] if tuple(shape) == like.shape:
                if len(data) == like.nbytes:
                    return np.frombuffer(data, like.dtype).reshape(like.shape).copy()
    elif isinstance(like, tuple):
        if isinstance(plain, list) and len(plain) == len(like):
            filled = [_filled(a, b, name) for a, b in zip(like, plain, strict=True)]
            return type(like)(*filled) if isinstance(like, Memory | SelfTestState) else tuple(filled)
    elif isinstance(like, Mapping):
        if isinstance(plain, dict) and set(plain) == set(like):
            return {key: _filled(like[key], plain[key], f"{name}.{key}") for key in like}
    elif _same_kind(like, plain):
        return plain
    raise UnfitError(f"its {name} does not fit this model")


def _same_kind(like: Any, plain: Any) -> bool:
    """Return whether a scalar has the type of another one."""
    if isinstance(like, bool) or isinstance(plain, bool):
        return isinstance(like, bool) and isinstance(plain, bool)
    numbers = (int, float, np.generic)
    if isinstance(like, numbers):
        return isinstance(plain, float) or (isinstance(plain, int) and abs(plain) < 2**63)
    return like is None or isinstance(plain, type(like))


def _moved(value: Any, by_s: float) -> Any:
    """Return a value with all its moments shifted, at any depth."""
    if isinstance(value, tuple):
        return tuple(_moved(one, by_s) for one in value)
    if isinstance(value, np.ndarray) and value.dtype.names:
        parts = _by_name(value)
        return _records(value, parts | {n: parts[n] + by_s for n in _MOMENTS.intersection(parts)})
    if not is_dataclass(value) or isinstance(value, type):
        return value
    parts = {field.name: getattr(value, field.name) for field in fields(value)}
    return replace(
        value, **{n: part + by_s if n in _MOMENTS else _moved(part, by_s) for n, part in parts.items()}
    )


def _compensation(plain: Any, fit: CheckpointFit) -> CompensationState | None:
    """Return the state of a compensation; None without one.

    With another setup, its values are those of a cold start, except for its zero and whether it was armed or
    released.
    """
    cold = fit.compensation
    state = plain.get("state") if isinstance(plain, dict) else None
    if cold is None or not isinstance(state, dict):
        return None
    if plain.get("setup") != fit.setup:
        state = {name: state[name] for name in _WHATEVER_SETUP if name in state}
    plain_state = _plain(cold) | state
    is_armed = plain_state["reason"] is None
    plain_state["reason"] = cold.reason if is_armed else plain_state["reason"]
    filled: CompensationState = _filled(cold, plain_state, "compensation")
    if not (np.isfinite(filled.table_um).all() and np.isfinite(filled.ends_um).all()):
        return None
    return replace(filled, reason=None) if is_armed else filled


_WHATEVER_SETUP = ("reason", "time_s", "zero", "released", "released_s")


def _remembered(like: Any, plain: Any, name: str) -> Any:
    """Return the memory of aligner or self-test; None if the checkpoint lacks it."""
    return None if like is None or plain is None else _filled(like, plain, name)


def _gap(plain: Any, fit: CheckpointFit) -> GapState | None:
    """Return the state of the open-loop residual; None if it is missing or does not fit."""
    if fit.gap is None or plain is None:
        return None
    try:
        state: GapState = _filled(fit.gap, plain, "gap")
    except UnfitError:
        return None
    arrays = (state.x, state.theta, state.P, state.sums, state.waiting)
    return state if all(np.isfinite(array).all() for array in arrays) else None
