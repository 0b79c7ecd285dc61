"""Page, MQTT and OPC UA of the real daemon: what they say of faults, and what becomes of them.

Outlets that are frozen or killed, and a broker that is gone and comes back. The page is open in Chromium
all the while and is never loaded again. Times are by the clock: nothing is left out that others held up,
because the queues of several processes with many threads add up to more than has passed.
"""

from __future__ import annotations

import itertools
import logging
import os
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyncua.sync import Client
from asyncua.ua.status_codes import StatusCodes
from asyncua.ua.uaerrors import UaError

from campaigns.faults.table import Row
from observer.outlets.opcua import NAMESPACE
from tests.bus.router import free_port
from tests.outlets.test_mqtt import Listener, broker
from tests.page.browser import SIZES, answers, chromium
from tests.patience import until
from tests.system.plant import (
    HELD_UP_S,
    PERIOD_S,
    PREFIX,
    Daemon,
    Machine,
    Subscriber,
    children_of,
    machine,
    table_for,
)

NAMES = ("page", "MQTT", "OPC UA")
STATES = ("good", "degraded", "stale")
STALE_S = (
    2 * PERIOD_S + 0.5
)  # two periods, 0.4 s of slack for the wire, and the page looks each tenth of a second
BACK_S = 1.0
AGAIN_S = 10.0  # a second until it is tried again, and a process that loads its libraries
TICKS = 60  # what they say is longer than Zenoh keeps a silent client
SAYS = "() => document.body.dataset.state"
SETTLED_S = 5.0
NOTE_WHEN_SILENT = """() => new MutationObserver((_, observer) => {
  if ("silent" in document.body.dataset) { window.silentSince_s = Date.now() / 1000; observer.disconnect(); }
}).observe(document.body, { attributes: true })"""
SILENT = "() => 'silent' in document.body.dataset"
STATUS = {
    StatusCodes.Good: "good",
    StatusCodes.UncertainSubNormal: "degraded",
    StatusCodes.UncertainLastUsableValue: "stale",
}


@dataclass
class Plant:
    """A daemon with its outlets, who listens to each, and their addresses."""

    machine: Machine
    daemon: Daemon
    seen: Subscriber
    page: Any
    listener: Listener
    broker: ExitStack
    folder: Path
    mqtt_port: int
    opcua: str

    def process(self, but: int = 0) -> int:
        """The process that serves the outlets; 0 where there is none but this one."""
        found = [
            p for p in children_of(self.daemon.process.pid) if p != but and b"observer.outlets" in _command(p)
        ]
        return found[0] if found else 0

    def qualities(self) -> dict[str, str]:
        """What each outlet says that the estimates are worth."""
        quality = self.listener.newest.get(f"{PREFIX}/quality", b"nothing").decode()
        return dict(zip(NAMES, (self.page.evaluate(SAYS), quality, _status(self.opcua)), strict=True))

    def wait_until_good(self) -> None:
        """Wait until every outlet says so."""
        until(lambda: set(self.qualities().values()) == {"good"})

    def stand_by(self) -> None:
        """Let a browser and the broker's client take what came meanwhile."""
        self.page.wait_for_timeout(100)


def measured(folder: Path) -> tuple[dict[str, tuple[str, ...]], list[Row]]:
    """What each outlet says where all is well, one sensor is at fault, and none is heard; and the rows."""
    with _served(folder) as plant:
        plant.wait_until_good()
        words = [plant.qualities()]
        plant.machine.fault(open="t3_degC")
        words.append(_settled(plant, "degraded"))
        plant.machine.fault()
        plant.wait_until_good()
        os.kill(plant.machine.pid, signal.SIGSTOP)
        words.append(_settled(plant, "stale"))
        os.kill(plant.machine.pid, signal.SIGCONT)
        plant.wait_until_good()
        begin = len(plant.daemon.step_times_s())
        stale_s = _frozen(plant)
        back_s = _without_broker(plant)
        again_s, will = _killed(plant)
        pause_s = _longest_pause_s(plant.daemon.step_times_s()[begin:])
    return {name: tuple(each[name] for each in words) for name in NAMES}, [
        _row(
            "page frozen with its process",
            f"STALE on it within 2 periods and 0.5 s; ticks at most {HELD_UP_S:g} s apart",
            f"STALE after {stale_s:.2f} s, periods are {PERIOD_S:g} s; ticks at most {pause_s:.1f} s apart",
            stale_s <= STALE_S and pause_s <= HELD_UP_S,
        ),
        _row(
            "MQTT broker gone",
            "its state published again within 1 s of its return",
            f"published again {back_s:.1f} s after a broker without memory",
            back_s <= BACK_S,
        ),
        _row(
            "outlets' process killed",
            f"last will published, page, MQTT and OPC UA again in ≤ {AGAIN_S:g} s",
            f"alive is {will}, all three are good again after {again_s:.1f} s",
            will == "false" and again_s <= AGAIN_S,
        ),
    ]


def _row(promise: str, figure: str, found: str, met: bool) -> Row:
    return Row("–", promise, figure, found, met)


@contextmanager
def _served(folder: Path) -> Iterator[Plant]:
    """A daemon on a simulated machine with all three, and whoever looks at them."""
    folder.mkdir()
    logging.getLogger("asyncua").setLevel(logging.ERROR)  # it warns of each client that comes and goes
    endpoint, listen, port = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}", free_port()
    opcua = f"opc.tcp://127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        made = stack.enter_context(machine())
        table = table_for(made.wires, listen=[endpoint]) | {
            "page": {"listen": listen},
            "mqtt": {"broker": f"127.0.0.1:{port}"},
            "opcua": {"listen": opcua},
        }
        brokers = stack.enter_context(ExitStack())
        brokers.enter_context(broker(folder, port))
        daemon = stack.enter_context(Daemon(folder, table))
        seen = stack.enter_context(Subscriber(endpoint))
        listener = stack.enter_context(Listener(port))
        seen.wait_until_good()
        until(lambda: answers(f"http://{listen}/assets/page.css"))
        browser = stack.enter_context(chromium())
        size = dict(zip(("width", "height"), SIZES["phone"], strict=True))
        page = browser.new_page(viewport=size)
        page.goto(f"http://{listen}/")
        page.wait_for_selector("tr[data-sensor]")
        yield Plant(made, daemon, seen, page, listener, brokers, folder, port, opcua)


def _settled(plant: Plant, expected: str) -> dict[str, str]:
    """What the outlets say once all say so, or after five seconds: health is published once a second."""
    begin_s = time.monotonic()

    def is_over() -> bool:
        plant.stand_by()
        return set(plant.qualities().values()) == {expected} or time.monotonic() > begin_s + SETTLED_S

    until(is_over)
    return plant.qualities()


def _frozen(plant: Plant) -> float:
    """How long the page took to say that it is stale once its process was frozen, by the page itself."""
    pid = plant.process()
    plant.page.evaluate(NOTE_WHEN_SILENT)
    begin_s = time.time()
    os.kill(pid, signal.SIGSTOP)
    until(lambda: plant.page.evaluate(SILENT))
    plant.seen.wait_for_more(TICKS)
    os.kill(pid, signal.SIGCONT)
    plant.wait_until_good()
    return float(plant.page.evaluate("() => window.silentSince_s")) - begin_s


def _without_broker(plant: Plant) -> float:
    """How long after its return a broker that remembers nothing had received everything that is retained."""
    plant.broker.close()
    until(lambda: any("no broker answers" in reason for reason in plant.seen.health()["reasons"]))
    plant.broker.enter_context(broker(plant.folder, plant.mqtt_port))
    until(lambda: _listens(plant.mqtt_port))
    begin_s = time.monotonic()
    wanted = {f"{PREFIX}/{key}" for key in ("alive", "quality", "health", "config")}
    with Listener(plant.mqtt_port) as new:
        until(lambda: wanted <= new.newest.keys() or time.monotonic() > begin_s + AGAIN_S)
        back_s = time.monotonic() - begin_s
    plant.wait_until_good()
    return back_s


def _killed(plant: Plant) -> tuple[float, str]:
    """How long until all three said good again after a kill, and what MQTT said of its life meanwhile."""
    first, newest = plant.process(), plant.listener.newest
    alive = f"{PREFIX}/alive"
    until(lambda: newest.get(alive) == b"true")
    begin_s = time.monotonic()
    os.kill(first, signal.SIGKILL)
    until(lambda: newest[alive] != b"true" or time.monotonic() > begin_s + AGAIN_S)
    will = newest[alive].decode()
    until(lambda: plant.process(but=first))

    def is_back() -> bool:
        plant.stand_by()
        up = newest[alive] == b"true" and not plant.page.evaluate(SILENT)
        return up and set(plant.qualities().values()) == {"good"}

    until(is_back)
    return time.monotonic() - begin_s, will


def _longest_pause_s(times_s: list[float]) -> float:
    return max(after - before for before, after in itertools.pairwise(times_s))


def _status(url: str) -> str:
    """What the status code of the nut's heat says; nothing where nobody answers."""
    try:
        with Client(url) as client:
            index = client.get_namespace_index(NAMESPACE)
            _, machine_name, axis = PREFIX.split("/")
            path = [f"{index}:{part}" for part in (machine_name, axis, "Heat", "nut", "Heat_W")]
            node = client.nodes.objects.get_child(path)
            code = node.read_data_value(raise_on_bad_status=False).StatusCode.value
    except (OSError, UaError, TimeoutError):
        return "nothing"
    return STATUS.get(code, f"{code:#x}")


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _command(pid: int) -> bytes:
    """How a process was called; nothing once it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""
