import tomllib

import pytest
from pydantic import TypeAdapter, ValidationError

from drivers import DriverSettings
from drivers.places import CAN_INPUTS, MODBUS_INPUTS, can_input, modbus_input
from observer.errors import UserError

SETTINGS = TypeAdapter(DriverSettings)

EXAMPLES = {
    "tcp, ready map": """
        kind = "modbus_tcp"
        host = "127.0.0.1"
        device = "wago_750_458"
        channels = { t1_degC = 0, t2_degC = 7 }
    """,
    "rtu, own map": """
        kind = "modbus_rtu"
        port = "/dev/ttyUSB0"
        [channels.t1_degC]
        register = 4
        type = "int32"
        word_order = "little"
        scale = 0.01
        fault_codes = { 0x7FFFFFFF = "open_circuit" }
        status_register = 9
        status_faults = { 0x20 = "open_circuit", 1 = "under_range" }
    """,
    "can": """
        kind = "can"
        interface = "virtual"
        channel = "x"
        dbc = "drivers/simulated/axis.dbc"
        [channels]
        nut_position_m = { message = "AxisStatus", signal = "NutPosition" }
    """,
    "canopen": """
        kind = "canopen"
        interface = "virtual"
        channel = "x"
        node_id = 5
        counts_per_m = 1e6
    """,
    "opcua": """
        kind = "opcua"
        url = "opc.tcp://127.0.0.1:4840"
        channels = { nut_position_m = { node = "ns=2;s=Axis.X.Position", scale = 0.001 } }
    """,
    "mtconnect": """
        kind = "mtconnect"
        url = "http://127.0.0.1:5000"
        channels = { nut_position_m = { item = "xpos" }, runs_1 = { item = "exec" } }
    """,
}


@pytest.mark.parametrize("text", EXAMPLES.values(), ids=EXAMPLES.keys())
def test_examples_are_accepted_and_open(text):
    driver = SETTINGS.validate_python(tomllib.loads(text)).open("d")
    assert driver.channels
    assert not driver.status.connected


def test_codes_may_be_written_as_in_the_manual():
    settings = SETTINGS.validate_python(tomllib.loads(EXAMPLES["rtu, own map"]))
    channel = settings.channels["t1_degC"]
    assert channel.fault_codes == {0x7FFFFFFF: "open_circuit"}
    assert channel.status_faults == {32: "open_circuit", 1: "under_range"}


BUS = {"interface": "virtual", "channel": "x"}
SOUND = {
    "modbus_tcp": {"host": "h", "channels": {"t": {"register": 0}}},
    "can": BUS | {"dbc": "a.dbc", "channels": {"t": {"message": "M", "signal": "S"}}},
    "canopen": BUS | {"node_id": 5, "counts_per_m": 1},
    "opcua": {"url": "opc.tcp://h", "channels": {"x_m": {"node": "i=1"}}},
    "mtconnect": {"url": "http://h", "channels": {"x_m": {"item": "a"}}},
    "profinet": {},
}
"""The least table of each kind, but for the last, which is none."""


def registers(**place):
    return {"channels": {"t": {"register": 0} | place}}


ZERO = r"scale\s+Value error, 0 makes every value the same"
REJECTED = [
    ("modbus_tcp", {"channels": {"t": 0}}, "needs device"),
    ("modbus_tcp", {"device": "micro800_tc2", "channels": {"t": 2}}, "inputs 0 to 1, not 2"),
    ("modbus_tcp", {"channels": {}}, "at least 1"),
    ("modbus_tcp", registers(scale=0), ZERO),
    ("modbus_tcp", registers(register=65535, type="float32"), "beyond register 65535"),
    ("modbus_tcp", registers(status_register=1), "belong together"),
    ("modbus_tcp", registers(regster=1), "regster"),
    ("modbus_tcp", registers(type="int32", word_order="big", byte_order="DCBA"), "give byte_order alone"),
    ("modbus_tcp", registers(type="int32", byte_order="ACBD"), "ABCD"),
    ("modbus_tcp", registers(type="float64") | {"max_registers": 3}, "make it at least 4"),
    ("can", {"device": "css_canmod_temp", "channels": {"t": 0}}, "exactly one of dbc and device"),
    *[("can", {"reopen_s": reopen_s}, "reopen_s") for reopen_s in (0, -1, 0.4, 1e9, "x")],
    ("canopen", {"mode": "sdo", "cob_id": 0x185}, "belongs to mode"),
    ("opcua", {"url": "http://127.0.0.1"}, r"opcua\.url"),
    ("opcua", {"channels": {"x_m": {"node": "Axis.X"}}}, r"channels\.x_m\.node\s+String should match"),
    ("opcua", {"channels": {"x_m": {"node": "ns=2;i=x"}}}, r"channels\.x_m\.node\s+String should match"),
    ("opcua", {"channels": {"x_m": {"node": "i=1"}, "y_m": {"node": "i=1"}}}, "give each its own"),
    ("opcua", {"channels": {"x_m": {"node": "i=1", "scale": 0}}}, ZERO),
    ("opcua", {"certificate": "a.pem"}, "belong together"),
    ("opcua", {"user": "me"}, "belong together"),
    ("opcua", {"user": "me", "password_file": "p"}, "in the clear"),
    ("mtconnect", {"url": "ftp://h"}, r"mtconnect\.url"),
    ("mtconnect", {"url": "http://user@h"}, r"mtconnect\.url"),
    ("mtconnect", {"device": "a/b"}, r"mtconnect\.device"),
    ("mtconnect", {"channels": {"x_m": {"item": "a"}, "y_m": {"item": "a"}}}, "give each its own"),
    ("mtconnect", {"channels": {"x_m": {"item": "a", "scale": 0}}}, ZERO),
    ("profinet", {}, "profinet"),
]


@pytest.mark.parametrize(("kind", "change", "words"), REJECTED)
def test_an_invalid_table_of_a_driver_is_rejected_before_anything_begins(kind, change, words):
    with pytest.raises(ValidationError, match=words):
        SETTINGS.validate_python({"kind": kind} | SOUND[kind] | change)


@pytest.mark.parametrize("device", [*MODBUS_INPUTS, *CAN_INPUTS])
def test_every_input_of_a_ready_map_has_its_own_place(device):
    is_can = device in CAN_INPUTS
    inputs = (CAN_INPUTS if is_can else MODBUS_INPUTS)[device]
    look_up = can_input if is_can else modbus_input
    places = [look_up(device, number) for number in range(inputs)]
    assert len({p.signal if is_can else p.register_ for p in places}) == inputs


@pytest.mark.parametrize(
    ("dbc", "message", "signal", "words"),
    [
        ("no/such.dbc", "AxisStatus", "NutPosition", "cannot be read"),
        ("pyproject.toml", "AxisStatus", "NutPosition", "not a valid DBC file"),
        ("drivers/simulated/axis.dbc", "Axis", "NutPosition", 'no message "Axis"; the file has AxisStatus'),
        ("drivers/simulated/axis.dbc", "AxisStatus", "Nut", 'no signal "Nut"; the message has NutPosition'),
    ],
)
def test_a_dbc_file_that_does_not_fit_is_one_sentence(dbc, message, signal, words):
    settings = SETTINGS.validate_python(
        {
            "kind": "can",
            "interface": "virtual",
            "channel": "x",
            "dbc": dbc,
            "channels": {"x_m": {"message": message, "signal": signal}},
        }
    )
    with pytest.raises(UserError, match=words) as caught:
        settings.open("axis")
    assert "\n" not in str(caught.value)
