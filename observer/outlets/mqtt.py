"""Every message to a broker of MQTT, under topics that are the Zenoh keys.

State is retained, so that late subscribers get it. `alive` is `false` as the last will. `quality` is the
quality of the estimates in one word, `stale` once the service is silent. Nothing waits for a missing broker.
Once it answers, it gets the newest message of each key. `observer.outlets.late` sends the missed ones.
"""

from __future__ import annotations

import asyncio
import ssl
import sys
from contextlib import suppress
from typing import Any

from paho.mqtt.client import Client, MQTTMessageInfo
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from observer.bus.exchange import RETAINED
from observer.config.outlets import Mqtt, ReportState, host_and_port
from observer.errors import ConfigError
from observer.files.regular import read_password
from observer.outlets.late import LateSender
from observer.outlets.messages import Latest
from observer.outlets.start import Start, run_together

_LOOK_S = 0.1
_RETRY_S = 1
_KEEPALIVE_S = 10
_END_S = 0.5
_AT_LEAST_ONCE = 1


async def serve(start: Start, latest: Latest, report_state: ReportState) -> None:
    """Publish until cancelled; raises `ConfigError` where a file of password or authority cannot be used."""
    assert start.mqtt is not None
    outlet = _Broker(start, start.mqtt, latest, report_state)
    late = () if outlet.late is None else (outlet.late.run(),)
    try:
        await run_together(outlet.pass_on(), outlet.look(), *late)
    finally:
        outlet.close()


class _Broker:
    """The connection to a broker, which a thread of the library keeps up."""

    def __init__(self, start: Start, settings: Mqtt, latest: Latest, report_state: ReportState) -> None:
        self._settings, self._latest, self._report_state = settings, latest, report_state
        self._topic = f"{settings.prefix}/{start.prefix}" if settings.prefix else start.prefix
        self.late: LateSender | None = None
        self._quality: str | None = None
        self._let_in = False
        self._loop = asyncio.get_running_loop()
        name = f"observer-{start.machine}-{start.axis}"
        if settings.prefix:
            name += f"-{settings.prefix.replace('/', '-')}"
        self._client = client = Client(CallbackAPIVersion.VERSION2, name)
        client.will_set(f"{self._topic}/alive", "false", _AT_LEAST_ONCE, retain=True)
        client.reconnect_delay_set(_RETRY_S, _RETRY_S)
        client.on_connect, client.on_disconnect = self._connected, self._disconnected
        client.on_connect_fail = lambda *_: self._report(self._why_not(sys.exception()))
        if settings.user is not None and settings.password_file is not None:
            client.username_pw_set(
                settings.user, read_password(settings.password_file, "mqtt.password_file", secret=False)
            )
        if settings.ca is not None:
            try:
                client.tls_set(str(settings.ca))
            except (OSError, ssl.SSLError) as error:
                raise ConfigError(
                    f"{settings.ca}: cannot be used ({error}); name a PEM file in mqtt.ca"
                ) from None
        if settings.late and start.recordings is not None:
            self.late = late = LateSender(start, latest, report_state, self._send_surely, client.is_connected)
            client.on_publish = lambda _client, _data, mid, *_: late.acknowledged(mid)
        client.connect_async(*host_and_port(settings.broker), keepalive=_KEEPALIVE_S)
        client.loop_start()
        self._report_state({"reason": f"mqtt: {self._no_broker()}"})

    async def pass_on(self) -> None:
        """Publish the service's messages as they arrive, for ever."""
        async for key, payload in self._latest.messages():
            if payload:
                self.put(key, payload)

    def put(self, key: str, payload: bytes) -> None:
        """Publish a message; without a broker it is dropped."""
        late = self.late
        if self._client.is_connected() and (late is None or late.can_send(key, payload)):
            retained = key in RETAINED
            surely = retained or (late is not None and late.is_settling)
            self._client.publish(
                f"{self._topic}/{key}", payload, _AT_LEAST_ONCE if surely else 0, retain=retained
            )

            if late is not None:
                late.note_sent(key, payload)

    def _send_surely(self, key: str, payload: bytes) -> MQTTMessageInfo:
        retained = key == "alive"
        message = self._client.publish(f"{self._topic}/{key}", payload, _AT_LEAST_ONCE, retain=retained)
        if message.rc == MQTTErrorCode.MQTT_ERR_NO_CONN:  # the library sends it on the next connection
            message.rc = MQTTErrorCode.MQTT_ERR_AGAIN
        return message

    async def look(self) -> None:
        """Publish the quality whenever it changes, until cancelled."""
        while True:
            quality = "stale" if self._latest.is_stale else self._latest.document("estimate").get("quality")
            if quality != self._quality and quality is not None and self._client.is_connected():
                self._quality = quality
                self._client.publish(f"{self._topic}/quality", quality, _AT_LEAST_ONCE, retain=True)
            await asyncio.sleep(_LOOK_S)

    def close(self) -> None:
        """Announce the end and disconnect."""
        if self.late is not None:
            self.late.close()
        if self._client.is_connected():
            with suppress(RuntimeError):  # the connection has just broken
                self._send_surely("alive", b"false").wait_for_publish(_END_S)
        self._client.disconnect()
        self._client.loop_stop()

    def _connected(self, _client: Any, _data: Any, _flags: Any, code: ReasonCode, _properties: Any) -> None:
        """On the library's thread: publish all retained messages, or report why the broker refuses."""
        if code.is_failure:
            broker = self._settings.broker
            self._report(f"the broker at {broker} refuses: {code}; check mqtt.user and its password")
            return
        self._let_in = True
        if self.late is not None:
            self.late.connected()
        self._loop.call_soon_threadsafe(self._begin)

    def _begin(self) -> None:
        self._quality = None
        self._client.publish(f"{self._topic}/alive", "true", _AT_LEAST_ONCE, retain=True)
        for key in RETAINED:
            if (payload := self._latest.payload(key)) is not None:
                self.put(key, payload)
        self._report_state({"reason": None, "address": self._settings.broker})

    def _disconnected(
        self, _client: Any, _data: Any, _flags: Any, code: ReasonCode, _properties: Any
    ) -> None:
        if code.is_failure and self._let_in:  # else the reason is known
            self._report(self._no_broker())
        self._let_in = False
        if self.late is not None:
            self.late.disconnected()

    def _no_broker(self) -> str:
        return f"no broker answers at {self._settings.broker}; start it, or change mqtt.broker"

    def _why_not(self, error: BaseException | None) -> str:
        """Return the reason of a failed connection, from the error that the library handles."""
        if isinstance(error, ssl.SSLError):
            cause = getattr(error, "verify_message", None) or error.reason
            return f"the broker at {self._settings.broker} is not trusted ({cause}); check mqtt.ca"
        return self._no_broker()

    def _report(self, reason: str) -> None:
        self._loop.call_soon_threadsafe(self._report_state, {"reason": f"mqtt: {reason}"})
