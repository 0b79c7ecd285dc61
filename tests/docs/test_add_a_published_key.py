"""The page that shows how to add a published key, followed in a copy: every outlet has the key."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from observer.exchange import KEYS
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "add-a-published-key.md"
FOLLOWED = '''
"""A publisher with all its outlets, and somebody at each of them."""
import asyncio, json, sys, urllib.request
from pathlib import Path

import zenoh
from asyncua import Client, ua

from observer.gateway.feed import Feed
from observer.gateway.opcua import NAMESPACE
from observer.gateway.start import Start
from observer.publish.session import session_config
from observer.publish.zenoh import ServiceIdentity, ZenohPublisher
from observer.tables.gateway import Metrics, Mqtt, Opcua, Page
from observer.tables.publishing import Publish
from tests.docs.reference import keys
from tests.gateway.test_mqtt import MOSQUITTO, Listener, broker
from tests.page.browser import CHROMIUM, chromium
from tests.patience import until
from tests.publish.blocks import LAYOUT, block
from tests.publish.router import free_port

ports = [free_port() for _ in range(5)]
endpoint, page, metrics, mqtt, opcua = (f"127.0.0.1:{port}" for port in ports)
has_broker = Path(MOSQUITTO).exists()
start = Start(
    machine="lathe", axis="z", period_s=60.0, page=Page(listen=page), metrics=Metrics(listen=metrics),
    mqtt=Mqtt(broker=mqtt) if has_broker else None, opcua=Opcua(listen=f"opc.tcp://{opcua}"),
)
publisher = ZenohPublisher(
    ServiceIdentity("lathe", "z", "0a0a0a0a"), Publish(mode="router", listen=(f"tcp/{endpoint}",)),
    '{"hash":"h"}', LAYOUT,
    outlet=Feed(start, b'{"config": {}}'),
)
step = 0

def publish():
    global step
    step += 1
    publisher.publish(block(1.8e9 + step), step)

def got(read):
    """What is read once it is there, while steps are published."""
    found = None
    def there():
        nonlocal found
        publish()
        try:
            found = read()
        except (OSError, ua.UaError, zenoh.ZError):
            return False
        return bool(found)
    until(there, pause_s=0.2)
    return found

def of_zenoh():
    with zenoh.open(session_config("client", (f"tcp/{endpoint}",), ())) as session:
        heard = session.declare_subscriber("ballscrew/lathe/z/hottest", zenoh.handlers.RingChannel(1))
        return got(lambda: (sample := heard.try_recv()) and json.loads(sample.payload.to_bytes()))

def of_metrics():
    with urllib.request.urlopen(f"http://{metrics}/metrics", timeout=5.0) as reply:
        lines = reply.read().decode().splitlines()
    return [line for line in lines if line.startswith("ballscrew_hottest_celsius{")]

def of_page():
    with urllib.request.urlopen(f"http://{page}/events", timeout=5.0) as events:
        for line in events:
            if line == b"event: hottest\\n":
                return json.loads(next(events).removeprefix(b"data: "))
            if line == b"event: beat\\n":
                return None

def of_browser():
    with chromium() as browser:
        tab = browser.new_page()
        tab.goto(f"http://{page}/")
        # in one call: the page replaces the rows at each step, and a replaced row has lost its layout
        cells = (
            "[...document.querySelectorAll('#more tr[data-key=hottest]')]"
            ".map((row) => [...row.cells].map((c) => c.innerText))"
        )
        return got(lambda: tab.evaluate(cells))

async def of_opcua():
    async with Client(f"opc.tcp://{opcua}") as client:
        index = await client.get_namespace_index(NAMESPACE)
        path = [f"{index}:{part}" for part in ("lathe", "z", "Hottest", "Temperature_degC")]
        value = await (await client.nodes.objects.get_child(path)).read_data_value(raise_on_bad_status=False)
        return [value.Value.Value, value.StatusCode.name]

def of_mqtt():
    with Listener(ports[3]) as listener:
        return got(lambda: listener.newest.get("hottest"))

def main(folder):
    publisher.start()
    found = {"zenoh": got(of_zenoh), "metrics": got(of_metrics), "page": got(of_page)}
    if CHROMIUM.exists():
        found["browser"] = of_browser()
    found["opcua"] = got(lambda: asyncio.run(of_opcua()))
    found["reference"] = [line for line in keys().splitlines() if line.startswith("| `hottest` |")]
    if has_broker:
        with broker(Path(folder), ports[3]):
            found["mqtt"] = json.loads(of_mqtt())
    publisher.close()
    print(json.dumps(found))

main(sys.argv[1])
'''


def extended(folder: Path) -> Path:
    """A package in which the page was followed: all the same files but for two."""
    document, name, entry = (body for _, language, body in blocks(PAGE) if language == "python")
    (folder / "observer").mkdir(parents=True)
    for package in ("drivers", "tests", "docs"):
        (folder / package).symlink_to(ROOT / package)
    for file in (ROOT / "observer").iterdir():
        if file.name not in ("publish", "exchange.py"):
            (folder / "observer" / file.name).symlink_to(file)
    publish = folder / "observer" / "publish"
    shutil.copytree(ROOT / "observer" / "publish", publish, ignore=shutil.ignore_patterns("__pycache__"))
    codec = (publish / "codec.py").read_text(encoding="utf-8")
    for at, text in (("    def learned(", document), ('            "heat": self.heat,\n', name)):
        assert at in codec
        codec = codec.replace(at, f"{text.rstrip()}\n{'' if text == name else chr(10)}{at}", 1)
    (publish / "codec.py").write_text(codec, encoding="utf-8")
    registry, at = (ROOT / "observer" / "exchange.py").read_text(encoding="utf-8"), '    "readings": Key('
    assert at in registry
    text = registry.replace(at, f"{entry.rstrip()}\n{at}", 1)
    (folder / "observer" / "exchange.py").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.system
def test_a_key_added_as_the_page_says_arrives_at_every_outlet(tmp_path: Path) -> None:
    assert "hottest" not in KEYS
    folder = extended(tmp_path / "extended")
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED, str(tmp_path)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    hottest_degC = found["zenoh"]["temperature_degC"]
    assert found["zenoh"]["quality"] == "good"
    assert 'quality="good"' in found["metrics"][0]
    assert float(found["metrics"][0].split()[-1]) == hottest_degC
    assert found["page"]["rows"][0] == ["Largest.", "", hottest_degC]
    assert found["opcua"] == [hottest_degC, "Good"]
    assert len(found["reference"]) == 1
    if "browser" in found:
        assert found["browser"][0] == ["hottest", "Largest.", f"{hottest_degC:.5g}"]
    if "mqtt" in found:
        assert found["mqtt"]["temperature_degC"] == hottest_degC
