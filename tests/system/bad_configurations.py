"""Wrong configurations, and the words by which the answer of `observer check` names what is wrong."""

from __future__ import annotations

from tests.system.bad_inputs import (
    CAN,
    MODBUS,
    NUTS,
    REGISTERS,
    Case,
    calibrate,
    changed,
    of_config,
    of_text,
    rows,
    text,
)

CONFIGURATIONS = [
    Case("no file", lambda f: ["check", "-c", str(f / "absent.toml")], ("absent.toml", "--config")),
    Case("a folder", lambda f: ["check", "-c", str(f)], ("cannot be read", "TOML file")),
    Case("not UTF-8", of_text(b"\xff\xfe[screw]"), ("config.toml", "UTF-8")),
    Case("not TOML", of_text(b"[screw\nlength_m = 1"), ("not valid TOML", "line 1")),
    Case("empty", of_text(b""), ("screw", "ambient", "source", "sensor", "is missing", "add it"), problems=4),
    Case("empty list", of_config(changed(sensor=[])), ("sensor", "0 entries", "at least 1")),
    Case("NUL", of_text(b"[screw]\n\0"), ("not valid TOML",)),
    Case("lists in lists", of_text(b"x = " + b"[" * 9000), ("config.toml", "give each a [name]")),
    Case("dots without end", of_text(b"x" + b".x" * 9000 + b" = 1"), ("config.toml", "give each a [name]")),
    Case("thousands of digits", of_text(b"x = " + b"9" * 9000), ("config.toml", "digits")),
    Case("a huge integer", of_config(changed(screw__length_m=10**300)), ("screw.length_m", "1e+300")),
    Case("true for a number", of_config(changed(screw__length_m=True)), ("screw.length_m", "number")),
    Case("one for a truth", of_config(changed(source__0__estimate=1)), ("estimate", "boolean")),
    Case("1e300", of_config(changed(screw__conductivity_W_mK=1e300)), ("conductivity_W_mK", "1e+300")),
    Case(
        "places without end",
        of_config(changed(output={"positions_m": [i / 2000 for i in range(1600)]})),
        ("output.positions_m", "1600 entries", "at most 1000"),
    ),
    Case(
        "nuts times places",
        of_config(changed(source=NUTS, output={"positions_m": [i / 500 for i in range(400)]})),
        ("4 moving nuts times 402 places", "report fewer"),
    ),
    Case("modes without end", of_config(changed(model__settle_s=1e-4)), ("settle_s", "give at least")),
    *(
        Case(
            f"a channel called {name!r}",
            of_config(changed(sensor__0__channel=name)),
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
        of_config(changed(drivers__tc=MODBUS | {"channels": {"flags": 0}})),
        ("drivers.tc", "flags", "another name"),
    ),
    Case(
        "everything at once",
        of_config(
            changed(
                screw__lenght_m=1.0,
                screw__length_m=None,
                screw__density_kg_m3=7.85,
                sensor__0__position_m=250.0,
                drivers__axis=CAN,
            )
        ),
        (
            "problems\n  screw.lenght_m: unknown key (did you mean length_m?)",
            "7850 (7.85 g/cm³)",
            "0.25 (250 mm)",
            "bad.dbc",
        ),
        problems=4,
    ),
    Case(
        "a misspelt key alone",  # it is not reported as missing too
        of_config(changed(screw__lenght_m=1.0, screw__length_m=None)),
        ("screw.lenght_m: unknown key (did you mean length_m?)",),
        problems=1,
    ),
    Case(
        "other unit",
        of_config(changed(screw__diameter_mm=36, screw__diameter_m=None)),
        ("screw.diameter_mm", "did you mean diameter_m"),
    ),
    Case(
        "capitals", of_config(changed(screw__Length_M=1.0, screw__length_m=None)), ("did you mean length_m",)
    ),
    Case(
        "a part of a key",
        of_config(changed(ambient={"temp": 22.0})),
        ("ambient.temp", "did you mean temperature_degC"),
    ),
    Case(
        "five channels on one register",
        of_config(changed(drivers__tc=REGISTERS)),
        ("drivers.tc", "a_degC, b_degC, c_degC, d_degC, e_degC", "same place"),
    ),
    Case(
        "delivered twice",
        of_config(changed(drivers__tc=MODBUS, drivers__other=MODBUS | {"port": 503})),
        ('"t1_degC"', "delivered by", "already"),
    ),
    Case(
        "a channel that no driver delivers",
        of_config(changed(drivers__tc=MODBUS)),
        ("no driver delivers t2_degC, nut_position_m", "add the channel"),
    ),
    Case("nut longer than the screw", of_config(changed(source__0__length_m=1.5)), ("source nut", "longer")),
    Case("unknown section", of_config(changed(sensors=[])), ("sensors", "did you mean sensor")),
    Case("missing section", of_config(changed(screw=None)), ("screw", "is missing")),
    Case("missing key", of_config(changed(screw__diameter_m=None)), ("screw.diameter_m", "is missing")),
    Case("wrong type", of_config(changed(screw__length_m="long")), ("screw.length_m", "number", "'long'")),
    Case("table for a number", of_config(changed(screw__length_m={"m": 1.0})), ("screw.length_m", "number")),
    Case(
        "out of range",
        of_config(changed(screw__length_m=-1.0)),
        ("screw.length_m", "greater than 0", "-1.0"),
    ),
    Case("NaN", of_config(changed(screw__length_m=float("nan"))), ("screw.length_m",)),
    Case(
        "sensor off the screw", of_config(changed(sensor__1__position_m=1.4)), ("sensor t2", "1.4", "beyond")
    ),
    Case("names twice", of_config(changed(sensor__1__name="t1")), ('called "t1"', "own name")),
    Case("channels twice", of_config(changed(sensor__1__channel="t1_degC")), ('"t1_degC"', "own name")),
    Case("two ambients", of_config(changed(ambient__channel="a")), ("ambient", "exactly one")),
    Case("no shape", of_config(changed(source__0__shape=None)), ('source "nut".shape', "is missing")),
    Case(
        "law half said",
        of_config(changed(source__0__speed_channel=None)),
        ('source "nut"', "needs speed_channel"),
    ),
    Case(
        "unknown kind of driver",
        of_config(changed(drivers__tc={"kind": "modbus"})),
        ("drivers.tc", "'modbus'", "modbus_tcp, modbus_rtu, can, canopen, opcua, mtconnect, player"),
    ),
    Case(
        "no kind of driver",
        of_config(changed(drivers__tc={"host": "x"})),
        ("drivers.tc", "kind is missing", "can"),
    ),
    Case(
        "driver no table",
        of_config(changed(drivers__tc=3)),
        ("drivers.tc", "table", "3", "write [drivers.tc]"),
    ),
    Case(
        "unknown key of a driver",
        of_config(changed(drivers__tc=MODBUS | {"prot": 502})),
        ("drivers.tc.prot", "did you mean port"),
    ),
    Case(
        "input beyond the device",
        of_config(changed(drivers__tc=MODBUS | {"channels": {"t1_degC": 9}})),
        ("drivers.tc", "t1_degC", "0 to 7"),
    ),
    Case(
        "input beyond all devices",
        of_config(changed(drivers__tc=MODBUS | {"channels": {"t1_degC": 99}})),
        ("drivers.tc.channels.t1_degC:", "63"),
    ),
    Case(
        "register beyond all",
        of_config(changed(drivers__tc=MODBUS | {"channels": {"a": {"register": 70000}}})),
        ("drivers.tc.channels.a.register:", "65535", "70000"),
    ),
    Case(
        "unknown fitted key",
        calibrate(text(rows()), table=changed(calibrate__free=["surface.colour"])),
        ("surface.colour",),
    ),
]
