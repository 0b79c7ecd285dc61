"""Wrong logs and options of each command, and the words by which its answer names what is wrong."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.system.bad_inputs import (
    CAN,
    MODBUS,
    TABLE,
    Case,
    calibrate,
    changed,
    of_config,
    rows,
    text,
    with_cell,
)
from tests.system.plant import write


def _of_log(
    content: str | bytes | None, name: str = "log.csv", output: str = "out"
) -> Callable[[Path], list[str]]:
    """A replay of a log with this content; None stands for no log at all."""

    def arguments(folder: Path) -> list[str]:
        if content is not None:
            (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
        config = write(folder, TABLE)
        return ["replay", str(folder / name), "--config", str(config), "--output", str(folder / output)]

    return arguments


def _to_a_file(folder: Path) -> list[str]:
    (folder / "out").write_text("mine")
    return _of_log(text(rows()))(folder)


def _beyond_a_file(folder: Path) -> list[str]:
    (folder / "file").write_text("mine")
    return _of_log(text(rows()), output="file/out")(folder)


def _simulate(program: str, output: str = "predicted.csv") -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "program.csv").write_text(program)
        config = write(folder, TABLE)
        return [
            "simulate",
            "-c",
            str(config),
            "--program",
            str(folder / "program.csv"),
            "-o",
            str(folder / output),
        ]

    return arguments


def _without(channel: str) -> str:
    column = rows()[0].index(channel)
    return text([row[:column] + row[column + 1 :] for row in rows()])


def _simulate_into_a_folder(folder: Path) -> list[str]:
    (folder / "predicted.csv").mkdir()
    return _simulate(text(rows()))(folder)


def _discover(log: str, output: str = "out", **changes: Any) -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "log.csv").write_text(log)
        config = write(folder, changed(**changes))
        return ["discover", str(folder / "log.csv"), "-c", str(config), "-o", str(folder / output)]

    return arguments


def _recent(*words: str) -> Callable[[Path], list[str]]:
    return lambda folder: of_config(TABLE, "discover", *words, "-o", str(folder / "out"))(folder)


def _without_sensors() -> str:
    """A log whose sensors never have a value."""
    return text([row if k == 0 else [row[0], "", "", *row[3:]] for k, row in enumerate(rows(800))])


def _discover_into_a_file(folder: Path) -> list[str]:
    (folder / "out").write_text("mine")
    return _discover(text(rows(800)))(folder)


def _calibrate_to_a_file(folder: Path) -> list[str]:
    (folder / "out").write_text("mine")
    return calibrate(text(rows(800)))(folder)


def _twice(of_one: Callable[[Path], list[str]]) -> Callable[[Path], list[str]]:
    """The same log again, under another name."""

    def arguments(folder: Path) -> list[str]:
        verb, log, *more = of_one(folder)
        again = folder / "again.csv"
        again.write_bytes(Path(log).read_bytes())
        return [verb, log, str(again), *more]

    return arguments


def _identify(log: str, *more: str) -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "log.csv").write_text(log)
        made = ["-c", str(write(folder, TABLE)), "-o", str(folder / "out")]
        return ["identify", str(folder / "log.csv"), *made, *more]

    return arguments


def _identify_to_a_file(folder: Path) -> list[str]:
    (folder / "out").write_text("mine")
    return _identify(text(rows()))(folder)


def _run(**changes: Any) -> Callable[[Path], list[str]]:
    return of_config(changed(**changes), "run", "--seconds", "0.5")


def _bad_dbc(folder: Path) -> list[str]:
    (folder / "bad.dbc").write_text("BO_ this is no database")
    return _run(drivers__can=CAN | {"dbc": str(folder / "bad.dbc")})(folder)


def _record_below_a_file(folder: Path) -> list[str]:
    (folder / "log.csv").write_text(text(rows()))
    (folder / "file").write_text("mine")
    player = {"kind": "player", "path": str(folder / "log.csv")}
    return _run(drivers__log=player, record__directory=str(folder / "file" / "recordings"))(folder)


LOGS = [
    Case("no log", _of_log(None), ("log.csv", "no such file")),
    Case("folder for a log", _of_log(None, "."), ()),
    Case("unknown suffix", _of_log("x", "log.jpg"), ("log.jpg", ".csv")),
    Case("empty", _of_log(""), ("log.csv", "holds no recognisable columns")),
    Case("no time", _of_log(text([r[1:] for r in rows()])), ("[log] time", "t1_degC")),
    Case("missing column", _of_log(_without("t2_degC")), ('"t2_degC"', "is missing", "add")),
    Case("time backwards", _of_log(with_cell(9, 0, "0.25")), ("row 9 (line 10)", "goes back", "sort")),
    Case(
        "text in a number",
        _of_log(with_cell(7, 2, "warm")),
        ("row 7 (line 8)", '"t2_degC"', "'warm'", "fix"),
    ),
    Case("a cell too many", _of_log(with_cell(7, 2, "1,2")), ("row 7 (line 8)", "6 cells", "5")),
    Case(
        "cut in the header of gzip",
        _of_log(gzip.compress(text(rows()).encode())[:12], "log.csv.gz"),
        ("log.csv.gz",),
    ),
    Case("binary", _of_log(bytes(range(256)) * 20), ("log.csv", "encoding")),
    Case("latin-1", _of_log("time_s,µ\n".encode("latin-1")), ("log.csv", "holds no recognisable columns")),
    Case("damaged CAN recording", _of_log("nonsense\n", "log.asc"), ("log.asc",)),
    Case("no sensor has a value", _of_log(_without_sensors()), ("log.csv: no sensor has a value in any",)),
    Case("output is a file", _to_a_file, ("out", "folder")),
    Case("output below a file", _beyond_a_file, ("file", "folder")),
]

OTHERS = [
    Case(
        "simulate: channel missing",
        _simulate(_without("screw_speed_rpm")),
        ('"screw_speed_rpm"', "is missing"),
    ),
    Case("simulate: output is a folder", _simulate_into_a_folder, ("predicted.csv", "cannot be written")),
    Case("simulate: unknown suffix", _simulate(text(rows()), "predicted.xls"), ("predicted.xls", ".csv")),
    Case("calibrate: a log twice", _twice(calibrate(text(rows(800)))), ("again.csv", "the same as", "once")),
    Case("discover: a log twice", _twice(_discover(text(rows(800)))), ("again.csv", "the same as", "once")),
    Case("calibrate: too short", calibrate(text(rows(2))), ("longest log", "300 s", "record")),
    Case("discover: too short", _discover(text(rows(2))), ("needs at least 300 s", "record")),
    Case("discover: no sensor has a value", _discover(_without_sensors()), ("no sensor", "check")),
    Case(
        "discover: no ambient",
        _discover(text(rows(800)), ambient={"channel": "air_degC"}),
        ('"air_degC"', "is missing"),
    ),
    Case(
        "discover: unknown kind left out",
        _discover(text(rows(800)), discover={"without": ["gravity"]}),
        ('"gravity"', "is no effect", "sensor_lag"),
    ),
    Case(
        "discover: nothing is free",
        _discover(text(rows(800)), calibrate={"free": []}),
        ("nothing is free", "[calibrate] free"),
    ),
    Case("discover: logs and recent hours", _recent("log.csv", "--recent", "8h"), ("name either logs or",)),
    Case("discover: neither logs nor recent hours", _recent(), ("name either logs or --recent",)),
    Case("discover: no duration", _recent("--recent", "8"), ("is not a duration",)),
    Case("discover: nothing is recorded", _recent("--recent", "8h"), ("no record.directory",)),
    Case("adopt: nothing", of_config(TABLE, "adopt"), ("name either the folder of results, or --status",)),
    Case("adopt: two things", of_config(TABLE, "adopt", "found", "--undo"), ("name either the folder",)),
    Case("adopt: no results", of_config(TABLE, "adopt", "absent"), ("holds no result.json or calibration",)),
    Case("adopt: nothing to undo", of_config(TABLE, "adopt", "--undo"), ("nothing was adopted in its",)),
    Case("discover: output is a file", _discover_into_a_file, ("out", "folder")),
    Case("calibrate: output is a file", _calibrate_to_a_file, ("out", "folder")),
    Case(
        "identify: option of another method", _identify(text(rows()), "--order", "0"), ("--order", "smoother")
    ),
    Case(
        "identify: two weights",
        _identify(text(rows()), "--method", "tikhonov", "--regularisation", "1", "--parameter-choice", "gcv"),
        ("--regularisation", "--parameter-choice", "one of them"),
    ),
    Case(
        "identify: too short",
        _identify(text(rows(2)), "--method", "conjugate-gradient"),
        ("log.csv", "three steps", "record"),
    ),
    Case("identify: output is a file", _identify_to_a_file, ("out", "folder")),
    Case("place: more than sites", of_config(TABLE, "place", "--sensors", "9", "--spacing-m", "0.5"), ()),
    Case(
        "place: no such candidates",
        of_config(TABLE, "place", "--candidates", "none.toml"),
        ("none.toml", "[[candidate]]"),
    ),
    Case("run: no driver", _run(), ("t1_degC", "[drivers.")),
    Case("run: a channel without a driver", _run(drivers__tc=MODBUS), ("t2_degC", "add the channel")),
    Case("run: bad DBC", _bad_dbc, ("bad.dbc",)),
    Case("run: no DBC", _run(drivers__can=CAN), ("bad.dbc",)),
    Case(
        "run: no recording to play", _run(drivers__log={"kind": "player", "path": "none.csv"}), ("none.csv",)
    ),
    Case("run: recordings below a file", _record_below_a_file, ("recordings", "directory")),
    Case("run: unknown mode", _run(publish__mode="hub"), ("publish.mode", "router")),
    Case(
        "run: bad endpoint",
        _run(publish__listen=["7447"]),
        ("publish.listen", "'7447'", "tcp/127.0.0.1:7447"),
    ),
    Case(
        "watch: bad endpoint",
        lambda f: ["watch", "--connect", "7447", "--seconds", "1"],
        ("7447", "--connect"),
    ),
    Case("health: bad endpoint", lambda f: ["health", "--connect", "7447"], ("7447", "--connect")),
    Case(
        "demo: bad endpoint", lambda f: ["demo", "--listen", "7447", "--seconds", "2"], ("7447", "--listen")
    ),
]

# What the option parser itself refuses: usage and reason, in several lines.
USAGE = [
    Case("unknown option", lambda f: ["check", "--colour"], ("--colour",)),
    Case("unknown command", lambda f: ["guess"], ("guess",)),
    Case("no configuration", lambda f: ["check"], ("--config",)),
    Case("seconds below nothing", of_config(TABLE, "run", "--seconds", "-1"), ("--seconds", "greater")),
    Case("unknown method", _identify("", "--method", "magic"), ("--method", "smoother")),
    Case("no sensors to place", of_config(TABLE, "place", "--sensors", "0"), ("--sensors", "greater")),
    Case(
        "no spacing",
        of_config(TABLE, "place", "--sensors", "2", "--spacing-m", "0"),
        ("--spacing-m", "greater"),
    ),
    Case(
        "unknown format",
        of_config(TABLE, "replay", "log.csv", "-o", "out", "--format", "xls"),
        ("--format", "csv"),
    ),
]
