"""The table of bad inputs: what a user may get wrong, and the words by which the answer names it."""

from __future__ import annotations

import copy
import gzip
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.system.plant import write

CHANNELS = ("t1_degC", "t2_degC", "nut_position_m", "screw_speed_rpm")
TABLE: dict[str, Any] = {
    "screw": {"length_m": 1.0, "diameter_m": 0.036, "conductivity_W_mK": 50.0, "density_kg_m3": 7800.0,
              "specific_heat_J_kgK": 460.0},
    "surface": {"convection_W_m2K": 15.0},
    "ambient": {"temperature_degC": 22.0},
    "source": [{"name": "nut", "shape": "nut", "length_m": 0.08, "position_channel": "nut_position_m",
                "speed_channel": "screw_speed_rpm", "torque_Nm": 0.3}],
    "sensor": [{"name": "t1", "channel": "t1_degC", "position_m": 0.05},
               {"name": "t2", "channel": "t2_degC", "position_m": 0.9}],
}  # fmt: skip
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
    """The good table with values put in (`screw__length_m`), or taken out where the value is None."""
    table = copy.deepcopy(TABLE)
    for path, value in by_path.items():
        *parents, last = path.split("__")
        at: Any = table
        for part in parents:
            at = at[int(part)] if part.isdigit() else at.setdefault(part, {})
        if value is None:
            del at[last]
        else:
            at[last] = value
    return table


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


def _of_config(table: dict[str, Any], command: str = "check", *more: str) -> Callable[[Path], list[str]]:
    return lambda folder: [command, "--config", str(write(folder, table)), *more]


def _of_text(content: bytes) -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "config.toml").write_bytes(content)
        return ["check", "--config", str(folder / "config.toml")]

    return arguments


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


def _calibrate(log: str, output: str = "out", table: dict[str, Any] = TABLE) -> Callable[[Path], list[str]]:
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


def _discover(log: str, output: str = "out", **changes: Any) -> Callable[[Path], list[str]]:
    def arguments(folder: Path) -> list[str]:
        (folder / "log.csv").write_text(log)
        config = write(folder, changed(**changes))
        return ["discover", str(folder / "log.csv"), "-c", str(config), "-o", str(folder / output)]

    return arguments


def _without_sensors() -> str:
    """A log whose sensors never have a value."""
    return text([row if k == 0 else [row[0], "", "", *row[3:]] for k, row in enumerate(rows(800))])


def _discover_into_a_file(folder: Path) -> list[str]:
    (folder / "out").write_text("mine")
    return _discover(text(rows(800)))(folder)


def _calibrate_to_a_file(folder: Path) -> list[str]:
    (folder / "out").write_text("mine")
    return _calibrate(text(rows(800)))(folder)


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
    return _of_config(changed(**changes), "run", "--seconds", "0.5")


def _bad_dbc(folder: Path) -> list[str]:
    (folder / "bad.dbc").write_text("BO_ this is no database")
    return _run(drivers__can=CAN | {"dbc": str(folder / "bad.dbc")})(folder)


def _record_below_a_file(folder: Path) -> list[str]:
    (folder / "log.csv").write_text(text(rows()))
    (folder / "file").write_text("mine")
    player = {"kind": "player", "path": str(folder / "log.csv")}
    return _run(drivers__log=player, record__directory=str(folder / "file" / "recordings"))(folder)


CONFIGURATIONS = [
    Case("no file", lambda f: ["check", "-c", str(f / "absent.toml")], ("absent.toml", "--config")),
    Case("a folder", lambda f: ["check", "-c", str(f)], ("cannot be read", "TOML file")),
    Case("not UTF-8", _of_text(b"\xff\xfe[screw]"), ("config.toml", "UTF-8")),
    Case("not TOML", _of_text(b"[screw\nlength_m = 1"), ("not valid TOML", "line 1")),
    Case(
        "empty", _of_text(b""), ("screw", "ambient", "source", "sensor", "is missing", "add it"), problems=4
    ),
    Case("empty list", _of_config(changed(sensor=[])), ("sensor", "0 entries", "at least 1")),
    Case("NUL", _of_text(b"[screw]\n\0"), ("not valid TOML",)),
    Case("lists in lists", _of_text(b"x = " + b"[" * 9000), ("config.toml", "flat")),
    Case("dots without end", _of_text(b"x" + b".x" * 9000 + b" = 1"), ("config.toml", "flat")),
    Case("thousands of digits", _of_text(b"x = " + b"9" * 9000), ("config.toml", "digits")),
    Case("a huge integer", _of_config(changed(screw__length_m=10**300)), ("screw.length_m", "1e+300")),
    Case("text for a number", _of_config(changed(screw__length_m="1.0")), ("screw.length_m", "number")),
    Case("true for a number", _of_config(changed(screw__length_m=True)), ("screw.length_m", "number")),
    Case("one for a truth", _of_config(changed(source__0__estimate=1)), ("estimate", "boolean")),
    Case("1e300", _of_config(changed(screw__conductivity_W_mK=1e300)), ("conductivity_W_mK", "1e+300")),
    Case(
        "places without end",
        _of_config(changed(output={"positions_m": [i / 2000 for i in range(1600)]})),
        ("output.positions_m", "1600 entries", "at most 1000"),
    ),
    Case(
        "nuts times places",
        _of_config(changed(source=NUTS, output={"positions_m": [i / 500 for i in range(400)]})),
        ("4 moving nuts times 402 places", "report fewer"),
    ),
    Case("modes without end", _of_config(changed(model__settle_s=1e-4)), ("settle_s", "give at least")),
    *(
        Case(
            f"a channel called {name!r}",
            _of_config(changed(sensor__0__channel=name)),
            ('sensor "t1".channel', word),
        )
        for name, word in (
            ("flags", "another name"),
            ("step", "another name"),
            ("time_s", "another name"),
            ("late_s", "another name"),
            ("command:arm", "another name"),
            ("a=b", "="),
            ("a;b", ";"),
            ("a,b", ","),
            ('"a"', "quote"),
            ("a\nb", "control"),
            (" a", "blanks"),
        )
    ),
    Case(
        "a driver's channel called flags",
        _of_config(changed(drivers__tc=MODBUS | {"channels": {"flags": 0}})),
        ("drivers.tc", "flags", "another name"),
    ),
    Case(
        "everything at once",
        _of_config(
            changed(
                screw__lenght_m=1.0,
                screw__length_m=None,
                screw__density_kg_m3=7.85,
                sensor__1__name="t1",
                sensor__0__position_m=250.0,
                drivers__axis=CAN,
            )
        ),
        (
            "problems\n  screw.lenght_m: unknown key (did you mean length_m?)",
            "7850 (7.85 g/cm³)",
            "0.25 (250 mm)",
            '2 entries of sensor are called "t1"',
            "bad.dbc",
        ),
        problems=5,
    ),
    Case(
        "unit left out",
        _of_config(changed(screw__length=1.0, screw__length_m=None)),
        ("screw.length", "did you mean length_m"),
    ),
    Case(
        "other unit",
        _of_config(changed(screw__diameter_mm=36, screw__diameter_m=None)),
        ("screw.diameter_mm", "did you mean diameter_m"),
    ),
    Case(
        "capitals", _of_config(changed(screw__Length_M=1.0, screw__length_m=None)), ("did you mean length_m",)
    ),
    Case(
        "a part of a key",
        _of_config(changed(ambient={"temp": 22.0})),
        ("ambient.temp", "did you mean temperature_degC"),
    ),
    Case(
        "five channels on one register",
        _of_config(changed(drivers__tc=REGISTERS)),
        ("drivers.tc", "a_degC, b_degC, c_degC, d_degC, e_degC", "same place"),
    ),
    Case(
        "delivered twice",
        _of_config(changed(drivers__tc=MODBUS, drivers__other=MODBUS | {"port": 503})),
        ('"t1_degC"', "delivered by", "already"),
    ),
    Case(
        "a channel that no driver delivers",
        _of_config(changed(drivers__tc=MODBUS)),
        ("no driver delivers t2_degC, nut_position_m", "add the channel"),
    ),
    Case("nut longer than the screw", _of_config(changed(source__0__length_m=1.5)), ("source nut", "longer")),
    Case(
        "unknown key", _of_config(changed(screw__lenght_m=1.0)), ("screw.lenght_m", "did you mean length_m")
    ),
    Case("unknown section", _of_config(changed(sensors=[])), ("sensors", "did you mean sensor")),
    Case("missing section", _of_config(changed(screw=None)), ("screw", "is missing")),
    Case("missing key", _of_config(changed(screw__diameter_m=None)), ("screw.diameter_m", "is missing")),
    Case("wrong type", _of_config(changed(screw__length_m="long")), ("screw.length_m", "number", "'long'")),
    Case("table for a number", _of_config(changed(screw__length_m={"m": 1.0})), ("screw.length_m", "number")),
    Case(
        "out of range",
        _of_config(changed(screw__length_m=-1.0)),
        ("screw.length_m", "greater than 0", "-1.0"),
    ),
    Case("NaN", _of_config(changed(screw__length_m=float("nan"))), ("screw.length_m",)),
    Case(
        "sensor off the screw", _of_config(changed(sensor__1__position_m=1.4)), ("sensor t2", "1.4", "beyond")
    ),
    Case("names twice", _of_config(changed(sensor__1__name="t1")), ('called "t1"', "own name")),
    Case("channels twice", _of_config(changed(sensor__1__channel="t1_degC")), ('"t1_degC"', "own name")),
    Case("two ambients", _of_config(changed(ambient__channel="a")), ("ambient", "exactly one")),
    Case("no shape", _of_config(changed(source__0__shape=None)), ('source "nut".shape', "is missing")),
    Case(
        "law half said",
        _of_config(changed(source__0__speed_channel=None)),
        ('source "nut"', "needs speed_channel"),
    ),
    Case(
        "unknown kind of driver",
        _of_config(changed(drivers__tc={"kind": "modbus"})),
        ("drivers.tc", "'modbus'", "modbus_tcp, modbus_rtu, can, canopen, opcua, mtconnect, player"),
    ),
    Case(
        "no kind of driver",
        _of_config(changed(drivers__tc={"host": "x"})),
        ("drivers.tc", "kind is missing", "can"),
    ),
    Case(
        "driver no table",
        _of_config(changed(drivers__tc=3)),
        ("drivers.tc", "table", "3", "write [drivers.tc]"),
    ),
    Case(
        "unknown key of a driver",
        _of_config(changed(drivers__tc=MODBUS | {"prot": 502})),
        ("drivers.tc.prot", "did you mean port"),
    ),
    Case(
        "input beyond the device",
        _of_config(changed(drivers__tc=MODBUS | {"channels": {"t1_degC": 9}})),
        ("drivers.tc", "t1_degC", "0 to 7"),
    ),
    Case(
        "input beyond all devices",
        _of_config(changed(drivers__tc=MODBUS | {"channels": {"t1_degC": 99}})),
        ("drivers.tc.channels.t1_degC:", "63"),
    ),
    Case(
        "register beyond all",
        _of_config(changed(drivers__tc=MODBUS | {"channels": {"a": {"register": 70000}}})),
        ("drivers.tc.channels.a.register:", "65535", "70000"),
    ),
    Case(
        "unknown fitted key",
        _calibrate(text(rows()), table=changed(calibrate__free=["surface.colour"])),
        ("surface.colour",),
    ),
]

LOGS = [
    Case("no log", _of_log(None), ("log.csv", "no such file")),
    Case("folder for a log", _of_log(None, "."), ()),
    Case("unknown suffix", _of_log("x", "log.txt"), ("log.txt", ".csv")),
    Case("empty", _of_log(""), ("log.csv", "time_s")),
    Case("header only", _of_log(text(rows()[:1])), ("no rows", "record")),
    Case("no time", _of_log(text([r[1:] for r in rows()])), ("first column", "time_s")),
    Case("missing column", _of_log(_without("t2_degC")), ('"t2_degC"', "is missing", "add")),
    Case("column twice", _of_log(with_cell(0, 2, "t1_degC")), ('"t1_degC"', "twice")),
    Case("time backwards", _of_log(with_cell(9, 0, "0.25")), ("row 9 (line 10)", "goes back", "sort")),
    Case("time repeats", _of_log(with_cell(9, 0, "3.5")), ("row 9 (line 10)", "repeats")),
    Case("NaN time", _of_log(with_cell(5, 0, "nan")), ("row 5 (line 6)", "time_s", "give seconds")),
    Case("infinite time", _of_log(with_cell(40, 0, "inf")), ("row 40 (line 41)", "time_s")),
    Case(
        "text in a number",
        _of_log(with_cell(7, 2, "warm")),
        ("row 7 (line 8)", '"t2_degC"', "'warm'", "mend"),
    ),
    Case("a cell too many", _of_log(with_cell(7, 2, "1,2")), ("row 7 (line 8)", "6 cells", "5")),
    Case("last row cut", _of_log(text(rows())[:-12]), ("cut off", "--accept-truncated")),
    Case("cut gzip", _of_log(gzip.compress(text(rows(400)).encode())[:-900], "log.csv.gz"), ("cut off",)),
    Case(
        "cut in the header of gzip",
        _of_log(gzip.compress(text(rows()).encode())[:12], "log.csv.gz"),
        ("log.csv.gz",),
    ),
    Case("not gzip", _of_log(text(rows()), "log.csv.gz"), ("damaged gzip", "again")),
    Case("not Parquet", _of_log(text(rows()), "log.parquet"), ("not Parquet", "again")),
    Case("binary", _of_log(bytes(range(256)) * 20), ("log.csv", "first column", "time_s")),
    Case("latin-1", _of_log("time_s,µ\n".encode("latin-1")), ("log.csv", "UTF-8")),
    Case("damaged CAN recording", _of_log("nonsense\n", "log.asc"), ("log.asc",)),
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
    Case("calibrate: a log twice", _twice(_calibrate(text(rows(800)))), ("again.csv", "the same as", "once")),
    Case("discover: a log twice", _twice(_discover(text(rows(800)))), ("again.csv", "the same as", "once")),
    Case("calibrate: too short", _calibrate(text(rows(2))), ("longest log", "300 s", "record")),
    Case("discover: too short", _discover(text(rows(2))), ("shorter than 300 s", "record")),
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
    Case("discover: output is a file", _discover_into_a_file, ("out", "folder")),
    Case("calibrate: output is a file", _calibrate_to_a_file, ("out", "folder")),
    Case(
        "identify: option of another method", _identify(text(rows()), "--order", "0"), ("--order", "smoother")
    ),
    Case(
        "identify: uneven log",
        _identify(text(rows()[:20] + rows()[25:]), "--method", "tikhonov"),
        ("log.csv", "uneven", "--method smoother"),
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
    Case("place: more than sites", _of_config(TABLE, "place", "--sensors", "9", "--spacing-m", "0.5"), ()),
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
    Case("seconds below nothing", _of_config(TABLE, "run", "--seconds", "-1"), ("--seconds", "greater")),
    Case("unknown method", _identify("", "--method", "magic"), ("--method", "smoother")),
    Case("no sensors to place", _of_config(TABLE, "place", "--sensors", "0"), ("--sensors", "greater")),
    Case(
        "no spacing",
        _of_config(TABLE, "place", "--sensors", "2", "--spacing-m", "0"),
        ("--spacing-m", "greater"),
    ),
    Case(
        "unknown format",
        _of_config(TABLE, "replay", "log.csv", "-o", "out", "--format", "xls"),
        ("--format", "csv"),
    ),
]
