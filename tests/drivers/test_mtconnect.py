"""The MTConnect driver against an agent in a process of its own, honest and hostile."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from contextlib import contextmanager

import pytest

from drivers.mtconnect import MtConnectSettings
from tests.drivers.harness import running
from tests.patience import PATIENCE_S
from tests.system.plant import ROOT

pytestmark = pytest.mark.system
HONEST = {
    "xpos": "250.5",
    "sspeed": "1200",
    "xload": "40.5",
    "xtemp": "31.25",
    "exec": "ACTIVE",
    "prog": "O12",
}


class Agent:
    """The agent's process."""

    def __init__(self, process):
        self._process = process
        self.port = json.loads(process.stdout.readline())["port"]

    def command(self, **command):
        self._process.stdin.write(json.dumps(command).encode() + b"\n")
        self._process.stdin.flush()
        assert json.loads(self._process.stdout.readline())["done"]


@contextmanager
def agent(port=0):
    command = [sys.executable, "-m", "tests.drivers.agent", str(port)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe) as process:
        try:
            served = Agent(process)
            served.command(set=HONEST)
            yield served
        finally:
            process.stdin.close()
            assert process.wait(PATIENCE_S) == 0


def settings(port, channels=None, **more):
    channels = channels or {"x_m": {"item": "xpos"}}
    table = {"kind": "mtconnect", "url": f"http://127.0.0.1:{port}", "channels": channels}
    return MtConnectSettings(**(table | {"period_s": 0.05, "timeout_s": 0.3} | more))


CHANNELS = {
    "x_m": {"item": "xpos"},
    "n_rpm": {"item": "sspeed"},
    "load_1": {"item": "xload", "scale": 0.01},
    "t_degC": {"item": "xtemp"},
    "runs_1": {"item": "exec"},
    "held_1": {"item": "exec", "equals": "FEED_HOLD"},
    "o12_1": {"item": "prog", "equals": "O12"},
}


async def test_items_come_in_the_units_of_the_house_and_words_as_one_or_zero():
    with agent() as peer:
        driver = settings(peer.port, CHANNELS, device="mill").open("cnc")
        async with running(driver) as cnc:
            reading = await cnc.until(lambda r: not r.faults)
            assert reading.values == pytest.approx(
                {"x_m": 0.2505, "n_rpm": 1200, "load_1": 0.405, "t_degC": 31.25, "runs_1": 1, "held_1": 0}
                | {"o12_1": 1}
            )
            peer.command(set={"exec": "FEED_HOLD", "prog": "O13", "xpos": "UNAVAILABLE"})
            reading = await cnc.until(lambda r: r.faults.get("x_m") == "unavailable")
            assert math.isnan(reading.values["x_m"])
            reading = await cnc.until(lambda r: r.values.get("held_1") == 1)
            assert (reading.values["runs_1"], reading.values["o12_1"]) == (0, 0)
            for text in ("", "abc", "1 2 3", "1e999", "nan", "0x10", "1" * 100):
                peer.command(set={"xpos": text})
                await cnc.until(lambda r: r.faults.get("x_m") in {"wrong_type", "not_finite"})
            peer.command(set={"xpos": "-1.5e1"})
            assert await cnc.good("x_m") == pytest.approx(-0.015)


async def test_a_missing_item_is_reported_in_a_sentence_and_the_others_continue():
    wrong = {
        "nowhere": "the agent has no data item nowhere; fix its item",
        "xtravel": "xtravel is a condition, which is not a number; name a sample or an event",
        "xpath": "xpath is in MILLIMETER_3D, which is not known here; name another item",
    }
    with agent() as peer:
        for item, sentence in wrong.items():
            channels = {"x_m": {"item": "xpos"}, "a_1": {"item": item}}
            async with running(settings(peer.port, channels).open("cnc")) as cnc:
                reading = await cnc.until(lambda r: "x_m" not in r.faults)
                assert reading.faults == {"a_1": "unknown_item"}
                assert cnc.driver.status.last_error == f"channel a_1: {sentence}"


HOSTILE = {
    "html": "no XML that can be trusted", "bomb": "no XML that can be trusted", "huge": "sends more than",
    "truncated": "", "cut": "no XML that can be trusted", "404": "HTTP 404", "500": "HTTP 500",
    "redirect": "HTTP 302", "version": " document of version 1 or 2", "empty": "no XML",
    "namespace": " document of version 1 or 2", "error": "the agent refuses: no such", "drip": "in time",
}  # fmt: skip


async def test_hostile_answers_are_faults_every_period_and_an_honest_one_is_taken_within_a_second():
    with agent() as peer:
        async with running(settings(peer.port).open("cnc")) as cnc:
            await cnc.good("x_m")
            for answer, sentence in HOSTILE.items():
                peer.command(answer=answer)
                await cnc.until(lambda r: "x_m" in r.faults)
                assert all(r.faults for r in await cnc.more(8)), answer
                assert sentence in cnc.driver.status.last_error, answer
                peer.command(answer="")
                assert await cnc.good("x_m", timeout_s=1.0) == pytest.approx(0.2505), answer
            peer.command(answer="twice")
            await cnc.until(lambda r: r.faults == {"x_m": "ambiguous"})


async def test_an_answer_out_of_a_cache_is_old_and_a_new_instance_is_asked_again():
    with agent() as peer:
        async with running(settings(peer.port, timeout_s=0.2).open("cnc")) as cnc:
            await cnc.good("x_m")
            peer.command(restart=True)
            await cnc.until(lambda _: "restarted" in str(cnc.driver.status.last_error))
            assert await cnc.good("x_m") == pytest.approx(0.2505)
            assert cnc.driver.status.reconnects == 1
            peer.command(answer="cached")
            await cnc.until(lambda r: r.faults == {"x_m": "stale"})


async def test_an_agent_that_returns_is_met_within_a_second():
    with agent() as peer:
        port = peer.port
    async with running(settings(port).open("cnc")) as cnc:
        assert await cnc.fault("x_m") == "disconnected"
        with agent(port):
            await cnc.good("x_m", timeout_s=1.0)
        await cnc.fault("x_m")
        assert all(r.faults for r in await cnc.more(5))
