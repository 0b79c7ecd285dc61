"""A machine with few channels and an hour of its log, which the tests write as others would."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from observer.files.logs import Log
from observer.files.writer import write_log
from observer.installation import Installation, load
from observer.intake.reading import read_channels
from tests.logs.machines import machine_text

NAMED = ("t1_degC", "t2_degC", "nut_position_m", "screw_speed_rpm", "ambient_degC")
START = datetime(2026, 11, 25, 8, 0, 0, tzinfo=UTC)
CONFIG = machine_text("nut")


@dataclass(frozen=True, slots=True)
class Truth:
    """What was: `time_s` since 1970 (n,), and each channel (n,) in the configuration's unit."""

    time_s: np.ndarray
    t1_degC: np.ndarray
    t2_degC: np.ndarray
    nut_position_m: np.ndarray
    screw_speed_rpm: np.ndarray
    ambient_degC: np.ndarray

    def moments(self) -> list[datetime]:
        return [datetime.fromtimestamp(float(t), UTC) for t in self.time_s]

    def values(self) -> list[np.ndarray]:
        """The channels, in the order of `NAMED`."""
        return [getattr(self, name) for name in NAMED]

    def write(self, path: Path, **changes: np.ndarray) -> Path:
        """Write a log in our own form; one cell in five of `t1_degC` is empty, and others have all digits."""
        columns = dict(zip(NAMED, self.values(), strict=True))
        columns["t1_degC"] = np.where(np.arange(len(self.time_s)) % 5, self.t1_degC / 3.0, np.nan)
        write_log(path, self.time_s, columns | changes)
        return path


def truth(rows: int = 240, step_s: float = 1.5) -> Truth:
    since_s = step_s * np.arange(rows)
    share = since_s / since_s[-1]
    return Truth(
        time_s=START.timestamp() + since_s,
        t1_degC=np.round(22.0 + 6.0 * share, 2),
        t2_degC=np.round(22.5 + 9.0 * share, 2),
        nut_position_m=np.round(0.5 + 0.25 * np.sin(since_s / 7.0), 4),
        screw_speed_rpm=np.round(1200.0 + 300.0 * np.cos(since_s / 7.0)),
        ambient_degC=np.round(21.5 + 0.5 * share, 2),
    )


def configured(folder: Path, more: str = "") -> Installation:
    """The configuration in a folder, with a `[log]` table of its own."""
    path = folder / "machine.toml"
    path.write_text(CONFIG + more, encoding="utf-8")
    return load(path)


def read(path: Path, more: str = "") -> Log:
    return read_channels(path, configured(path.parent, more))


def assert_is(log: Log, was: Truth, *, since_1970: bool = True, apart: float = 1e-9) -> None:
    """Every channel says what was, within the digits in which it was written."""
    begin_s = 0.0 if since_1970 else was.time_s[0]
    np.testing.assert_allclose(log.time_s, was.time_s - begin_s, rtol=0.0, atol=1e-4)
    for name, values in zip(log.channels, log.values.T, strict=True):
        np.testing.assert_allclose(values, getattr(was, name), rtol=0.0, atol=apart, err_msg=name)
