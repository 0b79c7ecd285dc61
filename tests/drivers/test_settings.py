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


REFUSED = {
    "an input without a device": ('kind="modbus_tcp"\nhost="h"\nchannels={t=0}', "needs device"),
    "an input the device has not": (
        'kind="modbus_tcp"\nhost="h"\ndevice="micro800_tc2"\nchannels={t=2}',
        "inputs 0 to 1, not 2",
    ),
    "scale 0": (
        'kind="modbus_tcp"\nhost="h"\nchannels.t={register=0, scale=0}',
        r"scale\s+Value error, 0 makes every",
    ),
    "beyond the last register": (
        'kind="modbus_tcp"\nhost="h"\nchannels.t={register=65535, type="float32"}',
        "beyond register 65535",
    ),
    "status without meaning": (
        'kind="modbus_tcp"\nhost="h"\nchannels.t={register=0, status_register=1}',
        "belong together",
    ),
    "unknown key": ('kind="modbus_tcp"\nhost="h"\nchannels.t={register=0, regster=1}', "regster"),
    "unknown kind": ('kind="profinet"', "profinet"),
    "no channel": ('kind="modbus_tcp"\nhost="h"\nchannels={}', "at least 1"),
    "dbc and device": (
        'kind="can"\ninterface="virtual"\nchannel="x"\ndbc="a.dbc"\ndevice="css_canmod_temp"\nchannels={t=0}',
        "exactly one of dbc and device",
    ),
    "sdo with cob_id": (
        'kind="canopen"\ninterface="virtual"\nchannel="x"\nnode_id=5\ncounts_per_m=1\nmode="sdo"\ncob_id=0x185',
        "belongs to mode",
    ),
}


@pytest.mark.parametrize(("text", "words"), REFUSED.values(), ids=REFUSED.keys())
def test_refusals_name_the_trouble(text, words):
    with pytest.raises(ValidationError, match=words):
        SETTINGS.validate_python(tomllib.loads(text))


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
