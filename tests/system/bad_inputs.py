"""A good configuration and log from which bad inputs are made, and what a case of a bad input is."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.logs.machines import machine_table, put_values
from tests.system.plant import write

CHANNELS = ("t1_degC", "t2_degC", "nut_position_m", "screw_speed_rpm")
TABLE = machine_table(
    "nut",
    machine=None,
    screw__expansion_1_K=None,
    ambient={"temperature_degC": 22.0},
    source__0__stroke_m=None,
    source__0__share=None,
    sensor__1__position_m=0.9,
)
MODBUS = {"kind": "modbus_tcp", "host": "127.0.0.1", "device": "wago_750_458", "channels": {"t1_degC": 0}}
NUTS = [TABLE["source"][0] | {"name": f"nut{i}"} for i in range(4)]
REGISTERS = {"kind": "modbus_tcp", "host": "127.0.0.1",
             "channels": {f"{c}_degC": {"register": 3} for c in "abcde"}}  # fmt: skip
CAN = {
    "kind": "can", "interface": "virtual", "channel": "none", "dbc": "bad.dbc",
    "channels": {c: {"message": "M", "signal": c} for c in CHANNELS},
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A command line, made in a folder, and words that its answer must have."""

    name: str
    arguments: Callable[[Path], list[str]]
    words: tuple[str, ...]
    problems: int = 1


def changed(**by_path: Any) -> dict[str, Any]:
    """Return the good table with other values, as `machine_table`."""
    return put_values(copy.deepcopy(TABLE), by_path)


def rows(n: int = 40) -> list[list[str]]:
    """A good log of n samples, header first."""
    rng = np.random.default_rng(3)
    body = [
        [
            f"{0.5 * k}",
            f"{25 + rng.normal(0, 0.1):.3f}",
            f"{25 + rng.normal(0, 0.1):.3f}",
            f"{0.3 + 0.01 * k}",
            "900",
        ]
        for k in range(n)
    ]
    return [["time_s", *CHANNELS], *body]


def text(table: list[list[str]]) -> str:
    return "".join(",".join(row) + "\n" for row in table)


def with_cell(row: int, column: int, cell: str) -> str:
    table = rows()
    table[row][column] = cell
    return text(table)


def of_config(table: dict[str, Any], command: str = "check", *more: str) -> Callable[[Path], list[str]]:
    return lambda folder: [command, "--config", str(write(folder, table)), *more]


def of_text(content: bytes) -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "config.toml").write_bytes(content)
        return ["check", "--config", str(folder / "config.toml")]

    return arguments


def calibrate(log: str, output: str = "out", table: dict[str, Any] = TABLE) -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "log.csv").write_text(log)
        return [
            "calibrate",
            str(folder / "log.csv"),
            "-c",
            str(write(folder, table)),
            "-o",
            str(folder / output),
        ]

    return arguments
