"""`python -m tests.drivers.agent`: an MTConnect agent of one axis over HTTP, as in its parts 1 and 2.

Says its port in one JSON line, then obeys lines on standard input: `{"set": {"xpos": "12.5"}}` gives items
values, `{"answer": "bomb"}` makes it hostile, `{"restart": true}` gives it another instance. It ends when its
standard input is closed. It shares nothing with the client.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

ITEMS = {
    "xpos": ("SAMPLE", "POSITION", "Position", 'units="MILLIMETER" nativeUnits="MILLIMETER"'),
    "sspeed": ("SAMPLE", "ROTARY_VELOCITY", "RotaryVelocity", 'units="REVOLUTION/MINUTE"'),
    "xload": ("SAMPLE", "LOAD", "Load", 'units="PERCENT"'),
    "xtemp": ("SAMPLE", "TEMPERATURE", "Temperature", 'units="CELSIUS"'),
    "xpath": ("SAMPLE", "PATH_POSITION", "PathPosition", 'units="MILLIMETER_3D"'),
    "exec": ("EVENT", "EXECUTION", "Execution", ""),
    "prog": ("EVENT", "PROGRAM", "Program", ""),
    "xtravel": ("CONDITION", "POSITION", "Normal", ""),
}
BOMB = (
    '<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {n} "{("&" + m + ";") * 10}">' for m, n in zip("abcdefgh", "bcdefghi", strict=True))
    + "]><b>&i;</b>"
)


class Agent:
    """What the agent knows."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.instance, self.sequence, self.answer = 1, 1, ""
        self.values = {item: ("UNAVAILABLE", _now(), 1) for item in ITEMS}
        self.frozen = ""

    def obey(self, command: dict[str, Any]) -> None:
        """Take a line of standard input."""
        with self.lock:
            self.answer = command.get("answer", self.answer)
            if command.get("restart"):
                self.instance += 1
                self.sequence = 1
            for item, text in command.get("set", {}).items():
                self.sequence += 1
                self.values[item] = (text, _now(), self.sequence)
            self.frozen = self.streams()

    def header(self) -> str:
        """The header of a document."""
        return (
            f'<Header creationTime="{_now()}" sender="agent" instanceId="{self.instance}" version="1.8.0.0" '
            f'bufferSize="1024" firstSequence="1" lastSequence="{self.sequence}" '
            f'nextSequence="{self.sequence + 1}"/>'
        )

    def devices(self) -> str:
        """The answer to a probe."""
        items = "".join(
            f'<DataItem id="{key}" category="{category}" type="{kind}" {units}/>'
            for key, (category, kind, _, units) in ITEMS.items()
        )
        device = f'<Device id="d" name="mill" uuid="m1"><DataItems>{items}</DataItems></Device>'
        return _document("Devices", "1.8", f"{self.header()}<Devices>{device}</Devices>")

    def streams(self) -> str:
        """The answer to a current."""
        events = "".join(
            f'<{ITEMS[key][2]} dataItemId="{key}" timestamp="{at}" sequence="{number}">{text}'
            f"</{ITEMS[key][2]}>"
            for key, (text, at, number) in self.values.items()
        )
        stream = f'<ComponentStream component="Linear" componentId="x"><Samples>{events}</Samples>'
        device = f'<DeviceStream name="mill" uuid="m1">{stream}</ComponentStream></DeviceStream>'
        return _document("Streams", "1.8", f"{self.header()}<Streams>{device}</Streams>")


class Handler(BaseHTTPRequestHandler):
    """Answers GET, honestly, or with the fault that was set."""

    agent: Agent
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Answer a request."""
        agent = self.agent
        with agent.lock:
            answer, what = agent.answer, self.path.rpartition("/")[2]
            body = agent.devices() if what == "probe" else agent.streams()
            body = agent.frozen if answer == "cached" and what == "current" else body
        if answer == "drip":
            self._drip(body)
            return
        status, body = _hostile(answer, body)
        data = body.encode()
        self.send_response(status)
        self.send_header("Content-Type", "text/xml")
        self.send_header("Content-Length", str(len(data) + 100 * (answer == "truncated")))
        self.end_headers()
        self.wfile.write(data)
        self.close_connection = answer == "truncated"

    def _drip(self, body: str) -> None:
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        for letter in body:
            self.wfile.write(letter.encode())
            self.wfile.flush()
            time.sleep(0.05)
            if self.agent.answer != "drip":
                break
        self.close_connection = True

    def handle(self) -> None:
        """Serve a connection; that the client has gone is no matter."""
        try:
            super().handle()
        except OSError:
            return

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


def _hostile(answer: str, body: str) -> tuple[int, str]:
    """Status and body of an answer of a kind; the honest one for a kind that is not listed."""
    return {
        "html": (200, "<!DOCTYPE html><html><body>Login</body></html>"),
        "bomb": (200, BOMB),
        "huge": (200, body.replace("</Header>", "") + "<!--" + "x" * 5_000_000 + "-->"),
        "truncated": (200, body[: len(body) // 2]),
        "cut": (200, body[: len(body) // 2]),
        "404": (404, "not found"),
        "500": (500, body),
        "redirect": (302, body),
        "version": (200, body.replace(":1.8", ":9.0")),
        "namespace": (200, body.replace("urn:mtconnect.org", "urn:example.org")),
        "error": (404, _document("Error", "1.8", "<Errors><Error errorCode='A'>no such</Error></Errors>")),
        "twice": (200, body.replace("<Samples>", '<Samples><Position dataItemId="xpos">7</Position>')),
        "empty": (200, ""),
    }.get(answer, (200, body))  # fmt: skip


def _document(kind: str, version: str, inside: str) -> str:
    name = f"MTConnect{kind}"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><{name} xmlns="urn:mtconnect.org:{name}:{version}">'
        f"{inside}</{name}>"
    )


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def main() -> None:
    """Serve until standard input is closed."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    agent = Agent()
    agent.obey({})
    handler = type("AgentHandler", (Handler,), {"agent": agent})
    server = ThreadingHTTPServer(("127.0.0.1", port), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    print(json.dumps({"port": server.server_address[1]}), flush=True)
    for line in sys.stdin:
        agent.obey(json.loads(line))
        print(json.dumps({"done": True}), flush=True)


if __name__ == "__main__":
    main()
