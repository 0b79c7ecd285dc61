"""The page that shows how to add a published key, followed in a copy: outlets and reference have it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from observer.bus.exchange import KEYS
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "add-a-published-key.md"
FOLLOWED = """
import json, urllib.request

import zenoh

from observer.outlets.beside import OutletsProcess
from observer.outlets.start import Start
from observer.bus.session import session_config
from observer.bus.zenoh import ServiceIdentity, ZenohPublisher
from observer.config.outlets import Metrics
from observer.config.publishing import Publish
from observer.process.shutdown import leave
from tests.docs.reference import keys
from tests.patience import until
from tests.bus.blocks import LAYOUT, block
from tests.bus.router import free_port

endpoint, metrics = (f"127.0.0.1:{free_port()}" for _ in range(2))
start = Start(machine="lathe", axis="z", period_s=60.0, metrics=Metrics(listen=metrics))
publisher = ZenohPublisher(
    ServiceIdentity("lathe", "z", "0a0a0a0a"), Publish(mode="router", listen=(f"tcp/{endpoint}",)),
    '{"hash":"h"}', LAYOUT,
    outlets=OutletsProcess(start),
)
step, received = 0, {}

def has(name, read):
    global step
    step += 1
    publisher.publish(block(1.8e9 + step), step)
    try:
        received[name] = read()
    except OSError:
        return False
    return bool(received[name])

def of_metrics():
    with urllib.request.urlopen(f"http://{metrics}/metrics", timeout=5.0) as reply:
        lines = reply.read().decode().splitlines()
    return [line for line in lines if line.startswith("ballscrew_hottest_celsius{")]

publisher.start()
with zenoh.open(session_config("client", (f"tcp/{endpoint}",), ())) as session:
    heard = session.declare_subscriber("ballscrew/lathe/z/hottest", zenoh.handlers.RingChannel(1))
    of_zenoh = lambda: (sample := heard.try_recv()) and json.loads(sample.payload.to_bytes())
    until(lambda: has("zenoh", of_zenoh), pause_s=0.2)
until(lambda: has("metrics", of_metrics), pause_s=0.2)
publisher.close()
received["reference"] = [line for line in keys().splitlines() if line.startswith("| `hottest` |")]
print(json.dumps(received))
leave(0)  # as the service does: a session that is still closing must not meet an interpreter that ends
"""


def extended(folder: Path) -> Path:
    """A package in which the page was followed: all the same files but for two."""
    document, name, entry = (body for _, language, body in blocks(PAGE) if language == "python")
    (folder / "observer").mkdir(parents=True)
    for package in ("drivers", "tests", "docs"):
        (folder / package).symlink_to(ROOT / package)
    for file in (ROOT / "observer").iterdir():
        if file.name != "bus":
            (folder / "observer" / file.name).symlink_to(file)
    bus = folder / "observer" / "bus"
    shutil.copytree(ROOT / "observer" / "bus", bus, ignore=shutil.ignore_patterns("__pycache__"))
    codec = (bus / "codec.py").read_text(encoding="utf-8")
    for at, text in (("    def learned(", document), ('            "heat": self.heat,\n', name)):
        assert at in codec
        codec = codec.replace(at, f"{text.rstrip()}\n{'' if text == name else chr(10)}{at}", 1)
    (bus / "codec.py").write_text(codec, encoding="utf-8")
    registry, at = (bus / "exchange.py").read_text(encoding="utf-8"), '    "readings": Key('
    assert at in registry
    (bus / "exchange.py").write_text(registry.replace(at, f"{entry.rstrip()}\n{at}", 1), encoding="utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.system
def test_a_key_added_as_the_page_says_is_published_exported_and_documented(tmp_path: Path) -> None:
    assert "hottest" not in KEYS
    folder = extended(tmp_path / "extended")
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    received = json.loads(done.stdout.splitlines()[-1])
    hottest_degC = received["zenoh"]["temperature_degC"]
    assert received["zenoh"]["quality"] == "good"
    assert 'quality="good"' in received["metrics"][0]
    assert float(received["metrics"][0].split()[-1]) == hottest_degC
    assert len(received["reference"]) == 1
