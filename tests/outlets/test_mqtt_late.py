"""Broken connections to a real broker: nothing that was recorded stays missing."""

from __future__ import annotations

import asyncio

import pytest

from observer.bus.codec import EstimateEncoder
from observer.config.outlets import Mqtt
from observer.outlets import late, process
from observer.outlets.messages import Latest
from observer.outlets.start import Start
from tests.bus.router import free_port
from tests.outlets.feeding import LAYOUT, block
from tests.outlets.test_mqtt import TOPIC, broker, pytestmark  # noqa: F401  (the marks hold here, too)
from tests.patience import eventually


async def test_a_task_of_an_outlet_that_ends_is_reported_and_restarted(tmp_path, monkeypatch):
    begun: list[str] = []
    reports: list[dict] = []

    async def run(_sender: late.LateSender) -> None:
        begun.append("late")
        if len(begun) == 1:
            raise RuntimeError("the connection dropped")
        await asyncio.Event().wait()

    monkeypatch.setattr(late.LateSender, "run", run)
    settings = Mqtt(broker=f"127.0.0.1:{free_port()}")
    start = Start(machine="lathe", axis="z", period_s=0.5, mqtt=settings, recordings=tmp_path)
    outlet = asyncio.create_task(process._supervised("mqtt", start, Latest(60.0), reports.append))
    try:
        await eventually(lambda: len(begun) == 2)
    finally:
        outlet.cancel()
        await asyncio.wait([outlet])
    assert {"reason": "mqtt: RuntimeError: the connection dropped"} in reports


def test_an_interval_too_short_to_tell_steps_apart_is_refused():
    with pytest.raises(ValueError, match=r"give 0, which is every step, or 0\.001"):
        Mqtt(broker="127.0.0.1:1883", late_every_s=1e-300)


def test_overtaken_steps_are_noticed_also_after_a_restart_of_the_service(tmp_path):
    start = Start(machine="lathe", axis="z", period_s=1.0, mqtt=Mqtt(late_every_s=0.0), recordings=tmp_path)
    sender = late.LateSender(start, Latest(1.0), lambda _: None, lambda *_: None, lambda: True)

    def sent(instance: str, sequence: int, time_s: float) -> None:
        encoder = EstimateEncoder(LAYOUT, instance)
        sender.can_send("estimate", encoder.cbor(block(time_s), 0, sequence))
        sender.note_sent("heat", encoder.heat(block(time_s), 0, sequence))

    sender.connected()
    sent("0a0a0a0a", 900, 10.0)
    sent("0b0b0b0b", 0, 20.0)
    assert sender.backlog.first is None
    sent("0b0b0b0b", 2, 22.0)
    assert sender.backlog.first.keys == ("heat",)
