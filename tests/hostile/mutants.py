"""Configurations that are wrong in one place or two: every kind of value, key and structure, by a seed."""

from __future__ import annotations

import copy
import datetime
import random
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from observer.errors import UserError
from observer.installation.examine import examine
from observer.report.check import findings
from tests.system.bad_inputs import CAN, MODBUS, TABLE

ROOT = Path(__file__).parents[2]
MOST_CPU_S = 20.0
"""Seconds of this process, so that a busy computer does not count."""
LONG = "x" * 100_000
NUMBERS: tuple[Any, ...] = (
    0, 0.0, -0.0, -1, 1, 1e300, -1e300, 1e-300, 5e-324, float("inf"), float("-inf"), float("nan"), 10**30,
    10**400, True, "1.0", "", LONG, [], {}, [1, 2], datetime.date(2024, 2, 29), datetime.time(1, 2),
)  # fmt: skip
FACTORS = (1e3, 1e-3, 1e6, 1e-6, 1e-4, 1e12, -1.0, 0.5, 2.0)
TEXTS: tuple[Any, ...] = (
    "", "\x00", "flags", "step", "time_s", "late_s", "command:arm", "a=b", "a;b", "a,b", '"', "'", "a\nb",
    LONG, "../..", "ä", "$(id)", "*", 3, 0.5, True, [], {}, ["a"], "nan", "ambient", "t1", "t1_degC",
    "/dev/zero",
)  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """What was changed, and the file that came of it."""

    label: str
    text: bytes


def tables() -> dict[str, dict[str, Any]]:
    """Good configurations: every example, the rig's, and one with every kind of driver."""
    found = {
        path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
        for path in (
            *sorted((ROOT / "config").glob("*.toml")),
            ROOT / "tests" / "data" / "rig" / "config.toml",
        )
    }
    tenths = {"t1_degC": {"register": 4, "scale": 0.1}}
    rtu = {"kind": "modbus_rtu", "port": "/dev/ttyS9", "channels": tenths}
    speed = {"screw_speed_rpm": {"message": "AxisStatus", "signal": "ScrewSpeed"}}
    can = CAN | {"dbc": str(ROOT / "drivers" / "simulated" / "axis.dbc"), "channels": speed}
    drive = {"kind": "canopen", "interface": "virtual", "channel": "x", "node_id": 5, "counts_per_m": 1e6}
    tcp = MODBUS | {"channels": {"t2_degC": 1}}
    drivers = {"rtu": rtu, "can": can, "drive": drive, "tcp": tcp}
    effects = [
        {"kind": "speed_convection", "gain": 0.1},
        {"kind": "sensor_lag", "target": "t1", "time_constant_s": 4.0},
    ]
    found["wired"] = copy.deepcopy(TABLE) | {"drivers": drivers, "effect": effects}
    return found


def mutants(count: int, seed: int) -> Iterator[Mutant]:
    """Draw so many mutants, each of one of the good configurations."""
    rng = random.Random(seed)
    good = tables()
    for number in range(count):
        name = rng.choice(sorted(good))
        table = copy.deepcopy(good[name])
        if rng.random() < 0.12:
            label, text = _bytes_changed(tomlkit.dumps(table).encode(), rng)
        else:
            changes = [_changed(table, rng) for _ in range(rng.choice((1, 1, 1, 2)))]
            label, text = "; ".join(changes), tomlkit.dumps(table).encode()
        yield Mutant(f"{number} {name}: {label}", text)


def _places(at: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if path:
        yield path
    for key, value in at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ():
        yield from _places(value, (*path, key))


def _changed(table: dict[str, Any], rng: random.Random) -> str:
    """Change one place; says what was done."""
    path = rng.choice(list(_places(table)))
    parent: Any = table
    for part in path[:-1]:
        parent = parent[part]
    key, old = path[-1], parent[path[-1]]
    way = rng.random()
    if isinstance(parent, dict) and way < 0.08:
        del parent[key]
        return f"{path} removed"
    if isinstance(parent, dict) and way < 0.2:
        new = _misspelt(str(key), rng)
        parent[new] = parent.pop(key)
        return f"{path} renamed {new[:20]!r}"
    parent[key] = _other(old, rng)
    return f"{path} = {str(parent[key])[:40]!r}" if parent[key] != 10**400 else f"{path} = 10**400"


def _misspelt(key: str, rng: random.Random) -> str:
    i = rng.randrange(len(key))
    return rng.choice((
        key[:i] + key[i + 1 :] or "x", key[:i] + key[i + 1 : i + 2] + key[i : i + 1] + key[i + 2 :],
        key.upper(), key.rsplit("_", 1)[0] + "_mm", key + "s", "x", "", LONG, "ä", "a b", "\n",
    ))  # fmt: skip


def _other(old: Any, rng: random.Random) -> Any:
    if isinstance(old, bool):
        return rng.choice((1, 0, "true", 0.5, [], {}, not old))
    if isinstance(old, int | float):
        return rng.choice(NUMBERS) if rng.random() < 0.4 else old * rng.choice(FACTORS)
    if isinstance(old, str):
        return rng.choice(TEXTS)
    if isinstance(old, list):
        many = [copy.deepcopy(one) for one in old for _ in range(300)]
        return rng.choice(([], old + copy.deepcopy(old), many, old[:1], [old], 3, "x", {}, [{}], [3]))
    return rng.choice(({}, 3, "x", [], [old], {"x": old}, _nested(15), _nested(60)))


def _nested(depth: int) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for _ in range(depth):
        table = {"a": table}
    return table


def _bytes_changed(text: bytes, rng: random.Random) -> tuple[str, bytes]:
    i, j = sorted(rng.randrange(len(text)) for _ in range(2))
    ways = {
        "cut": text[:i],
        "a piece gone": text[:i] + text[min(j, i + 40) :],
        "a piece twice": text[:j] + text[max(i, j - 200) : j] + text[j:],
        "NUL": text[:i] + b"\0" + text[i:],
        "not UTF-8": text[:i] + b"\xff\xfe" + text[i:],
        "another byte": text[:i] + bytes([rng.randrange(256)]) + text[i + 1 :],
        "lists in lists": text + b"\nx = " + b"[" * 3000 + b"]" * 3000,
        "tables in tables": text + b"\n[" + b".".join([b"a"] * 3000) + b"]\n",
        "a number of many digits": text + b"\nx = " + b"9" * 5000,
        "a hexadecimal number of many digits": text + b"\nx = 0x" + b"f" * 9000,
        "much": text + b"# much\n" * 700_000,
        "a BOM": b"\xef\xbb\xbf" + text,
    }
    label = rng.choice(sorted(ways))
    return f"{label} at {i}", ways[label]


def verdict(mutant: Mutant, folder: Path) -> str:
    """What `observer check` makes of a mutant: "accepted", or the words of its refusal.

    Raises `AssertionError` for an answer that is none, and whatever else comes instead of an answer.
    """
    path = folder / "mutant.toml"
    path.write_bytes(mutant.text)
    start_s = time.process_time()
    try:
        findings(examine(path))
        said = "accepted"
    except UserError as error:
        said = str(error)
        _assert_readable(said)
    spent_s = time.process_time() - start_s
    assert spent_s < MOST_CPU_S, f"took {spent_s:.0f} s"
    return said


def _assert_readable(said: str) -> None:
    first, *rest = said.split("\n")
    assert first
    assert not rest or first.endswith("problems"), said[:500]
    for line in (first, *rest):
        assert line.isprintable(), line[:500]
        assert len(line) < 2000, line[:500]
    assert len(rest) <= 60
