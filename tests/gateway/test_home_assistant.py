"""Home Assistant's discovery over a real broker, checked against what its documentation allows."""

from __future__ import annotations

import json
import re

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from observer.gateway.home_assistant import state_of
from observer.gateway.messages import Latest
from observer.tables.gateway import Mqtt
from tests.gateway import test_mqtt
from tests.gateway.feeding import ALARM, fed_gateway
from tests.gateway.test_mqtt import broker
from tests.patience import until
from tests.publish.router import free_port

pytestmark = test_mqtt.pytestmark
DESCRIBED = "homeassistant/device/ballscrew_lathe_z/config"
STATE = "ballscrew/lathe/z/home_assistant"
# home-assistant.io/integrations/sensor.mqtt and /integrations/sensor/#device-class, 2026
UNITS = {"power": {"mW", "W", "kW", "MW", "GW", "TW"}, "temperature": {"°C", "°F", "K"}}
WITHOUT_UNIT = {"timestamp", "enum"}
KEYS = {
    "platform", "name", "unique_id", "state_topic", "value_template", "availability_topic",
    "payload_available",
    "payload_not_available", "device_class", "unit_of_measurement", "state_class", "options",
    "suggested_display_precision",
}  # fmt: skip
PLATFORMS = {"sensor", "binary_sensor"}


class Home:
    """What Home Assistant would have heard: the newest of every topic, and the entities it accepts."""

    def __init__(self, port: int) -> None:
        self.newest: dict[str, bytes] = {}
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = lambda client, *_: client.subscribe(
            [(f"{name}/#", 1) for name in ("homeassistant", "ballscrew", "house")]
        )
        self._client.on_message = lambda _client, _data, m: self.newest.update({m.topic: m.payload})
        self._client.connect_async("127.0.0.1", port)
        self._client.loop_start()

    def __enter__(self) -> Home:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def state(self) -> dict:
        return json.loads(self.newest.get(STATE) or b"{}")

    def components(self, topic: str = DESCRIBED) -> dict[str, dict]:
        """The entities of a description that Home Assistant accepts."""
        assert re.fullmatch(r"[\w-]+(/[\w-]+)*/device/[a-zA-Z0-9_-]+/config", topic)
        document = json.loads(self.newest[topic])
        assert document["device"]["identifiers"]
        assert document["origin"]["name"]
        for key, component in document["components"].items():
            assert component.keys() <= KEYS
            assert component["platform"] in PLATFORMS
            assert component["unique_id"]
            kind, unit = component.get("device_class"), component.get("unit_of_measurement")
            if component["platform"] == "sensor":
                assert kind is None or kind in UNITS.keys() | WITHOUT_UNIT
                assert unit in UNITS.get(kind, {unit})
                assert not (kind in WITHOUT_UNIT and (unit or component.get("state_class")))
                assert (kind == "enum") == ("options" in component)
                assert component["value_template"] == f"{{{{ value_json.{key} }}}}"
            assert re.fullmatch(r"[a-zA-Z_][a-zA-Z0-9_]*", key)  # as an attribute in a template
            assert component["availability_topic"] in self.newest
        ids = [component["unique_id"] for component in document["components"].values()]
        assert len(set(ids)) == len(ids)
        return document["components"]


def test_a_machine_is_described_with_units_and_its_state_has_every_value(tmp_path) -> None:
    port = free_port()
    settings = Mqtt(broker=f"127.0.0.1:{port}", home_assistant=True)
    with broker(tmp_path, port), fed_gateway(mqtt=settings) as feed:
        until(lambda: feed.said()["reason"] is None)
        feed.document("config", {"config": {"source": [{"position_channel": "x_m"}]}})
        feed.document("readings", {"channels": {"x_m": {"value": 0.75, "quality": "good"}}})
        feed.document("forecast", {"time_s": 1.0, "quality": "good", "settled_at_s": 1234.5})
        feed.document("health", {"state": "degraded"})
        feed.document("alarms", {"time_s": 1.0, "alarms": [ALARM], "bands": {}})
        feed.estimate()
        with Home(port) as home:
            until(lambda: home.state().get("alarms") and DESCRIBED in home.newest)
            until(lambda: home.newest.get("ballscrew/lathe/z/alive") == b"true")
            components, state = home.components(), home.state()
            assert state == {
                "heat_nut_W": 26.5, "heat_left_W": 3.25, "error_nut_um": 10.0, "error_largest_um": 12.0,
                "temperature_highest_degC": 25.5, "settled_at": "1970-01-01T00:20:34.500000+00:00",
                "quality": "good", "health": "degraded", "alarms": 1,
                "alarm": "major sensor_fault.t2.open_circuit: open",
            }  # fmt: skip
            assert components.keys() == state.keys() | {"problem"}
            assert components["heat_nut_W"]["unit_of_measurement"] == "W"
            assert components["error_nut_um"].get("device_class") is None
            assert state["quality"] in components["quality"]["options"]
            feed.estimate("degraded")
            until(lambda: home.state()["quality"] == "degraded")
            assert home.state()["heat_nut_W"] is None
            assert home.state()["error_largest_um"] is None
        # who comes later finds all of it retained
        with Home(port) as late:
            until(lambda: DESCRIBED in late.newest and STATE in late.newest)
            until(lambda: "ballscrew/lathe/z/alive" in late.newest)
            assert late.components().keys() == components.keys()


def test_it_may_have_another_prefix_and_is_removed_when_switched_off(tmp_path) -> None:
    port = free_port()
    with broker(tmp_path, port), Home(port) as home:
        for wanted, there in ((True, True), (None, True), (False, False)):
            settings = Mqtt(broker=f"127.0.0.1:{port}", home_assistant=wanted)
            with fed_gateway(mqtt=settings) as feed:
                until(lambda: feed.said()["reason"] is None)
                feed.estimate()
                until(lambda: home.newest.get("ballscrew/lathe/z/quality") == b"good")
                until(lambda there=there: bool(home.newest.get(DESCRIBED)) is there)
                until(lambda there=there: bool(home.newest.get(STATE)) is there)
        settings = Mqtt(broker=f"127.0.0.1:{port}", home_assistant="house/discovery")
        with fed_gateway(mqtt=settings) as feed:
            until(lambda: feed.said()["reason"] is None)
            feed.estimate()
            other = "house/discovery/device/ballscrew_lathe_z/config"
            until(lambda: home.newest.get(other))
            assert home.components(other)


def test_before_the_first_estimate_nothing_is_said() -> None:
    assert state_of(Latest(1.0)) is None
