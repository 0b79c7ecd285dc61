"""A real service is commanded by the program's own commands, and stays the only one of its name."""

from __future__ import annotations

import json
import random
import threading

import pytest
import zenoh

from observer.bus.session import session_config
from observer.bus.watch import SHOWN
from observer.files.logs import read_log
from tests.bus.people import published
from tests.bus.router import free_port
from tests.patience import PATIENCE_S
from tests.system.plant import (
    AXIS,
    COMPENSATION,
    START_S,
    Daemon,
    Subscriber,
    ask,
    machine,
    run_observer,
    service,
    table_for,
    until,
    write,
)
from tests.system.terminal import Terminal
from tests.system.test_recording import _assert_same, _replay, _rows

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]


@pytest.mark.slow
def test_reset_and_disarm_are_done_recorded_and_replayed_to_the_last_bit(tmp_path):
    with service(tmp_path, compensation=COMPENSATION) as (_, daemon, seen):
        seen.wait_until_good()
        for kind, text in (("arm", "armed"), ("reset", "the estimator restarts")):
            done = ask(kind, seen.endpoint)
            assert done.returncode == 0, done.stdout + done.stderr
            assert json.loads(done.stdout)["text"] == text
        until(lambda: seen.documents["compensation"][-1]["armed"] is False, 20)
        assert "has reset the estimator" in seen.documents["compensation"][-1]["reason"]
        seen.wait_until_good()
        assert ask("disarm", seen.endpoint).returncode == 0
        wrong = ask("reset", seen.endpoint, "--config-hash", "0123456789abcdef")
        assert wrong.returncode == 1
        assert "not in force" in wrong.stdout
        count = len(seen.estimates)
        until(lambda: len(seen.estimates) > count + 30, 60)
        instances = {m["instance"] for d in seen.documents.values() for m in d}
        assert instances == {e["instance"] for e in seen.estimates}
        assert len(instances) == 1
        daemon.stop()
        live = list(seen.estimates)
    said = [json.loads(line) for line in daemon.said().splitlines() if '"event": "command"' in line]
    assert [(s["command"], s["done"]) for s in said] == [
        ("arm", True), ("reset", True), ("disarm", True), ("reset", False)
    ]  # fmt: skip
    flags = [f for f in read_log(daemon.recording()).flags if f and f.startswith("!")]
    assert [f.split(" ")[0] for f in flags] == ["!arm=done", "!reset=done", "!disarm=done", "!reset=refused"]
    assert all("%40" in f for f in flags)  # who it says to be
    replayed = _rows(_replay(daemon.recording(), daemon.config, tmp_path / "one"))
    assert len(live) > 40
    for message in live:
        _assert_same(message, replayed[message["time_s"]])


def test_a_second_service_of_the_same_name_does_not_start(tmp_path):
    with service(tmp_path) as (plant, daemon, seen):
        seen.wait_until_good()
        for mode in ("client", "peer"):
            second = table_for(plant.wires, mode=mode, connect=[seen.endpoint])
            config = write(tmp_path, second, f"{mode}.toml")
            done = run_observer("run", "--config", str(config), "--seconds", "60")
            assert done.returncode == 2, done.stderr
            assert "observer: another service runs as ballscrew/demo/x; end it" in done.stderr
            assert "Traceback" not in done.stderr
        daemon.stop()


@pytest.mark.parametrize("kind", ["arm", "disarm", "reset"])
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--machine", "a*", "--axis", "x"), "--machine: 'a*' is not a valid name"),
        (("--machine", "a/b", "--axis", "x"), "--machine: 'a/b' is not a valid name"),
        (("--machine", "a", "--axis", "x?config=1"), "is not a valid name"),
        (
            (*AXIS, "--client", "/nowhere.toml"),
            "/nowhere.toml: no such file; give the path of a client's file",
        ),
    ],
)
def test_a_command_names_one_axis(kind, words, sentence, command):
    code, _, errors = command([kind, *words, "--connect", "tcp/127.0.0.1:9", "--timeout-s", "0.5"])
    assert code == 2
    assert sentence in errors
    assert "Traceback" not in errors


def test_a_command_that_nobody_answers_says_so():
    for kind in ("arm", "health"):
        done = run_observer(kind, *AXIS, "--connect", f"tcp/127.0.0.1:{free_port()}", "--timeout-s", "0.5")
        assert done.returncode == 1
        assert "no service answers at" in done.stdout
        assert done.stderr == ""


def test_health_is_bad_while_no_sensor_has_ever_been_heard_and_good_once_one_is(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    def health():
        done = run_observer("health", "--json", "--connect", endpoint, "--timeout-s", "20")
        return (done.returncode, json.loads(done.stdout)) if done.stdout.startswith("{") else None

    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        module = table["drivers"]["thermocouples"]["port"]
        table["drivers"]["thermocouples"]["port"] = free_port()
        with Daemon(tmp_path, table) as daemon:
            code, document = until(health, START_S)
            daemon.stop()
        assert (code, document["state"], document["quality"]) == (1, "starting", "invalid")
        assert any("driver thermocouples is not connected" in reason for reason in document["reasons"])
        table["drivers"]["thermocouples"]["port"] = module
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            until(lambda: (health() or (1,))[0] == 0)
            daemon.stop()


def test_health_is_for_people_with_colour_only_in_a_terminal_and_one_line_of_json_on_demand():
    report = {"state": "good", "quality": "good", "reasons": [], "channels": {"t1_degC": {"quality": "good"}}}
    with published() as (made, endpoint):
        made.document("health", report)
        words = ("health", "--json", "--connect", endpoint)
        piped = until(lambda: (done := run_observer(*words)).returncode == 0 and done)
        assert json.loads(piped.stdout) == report | {"sequence": None, "sensors_used": 0, "sensors": 2}
        assert piped.stdout.count("\n") == 1
        alarm = {"id": "heat_high.nut", "severity": "minor", "state": "active", "remedy": "look at the nut"}
        made.document("alarms", {"alarms": [alarm]})
        plain = until(
            lambda: "minor" in (done := run_observer("health", "--connect", endpoint)).stdout and done
        )
        assert "\x1b" not in plain.stdout
        assert "  to do: look at the nut" in plain.stdout
        with Terminal("-m", "observer", "health", "--connect", endpoint) as terminal:
            assert terminal.process.wait(PATIENCE_S) == 0
            until(lambda: "minor heat_high.nut (active)" in terminal.shown())
            assert "lathe-7/z" in terminal.shown()
            assert "service: good" in terminal.shown()
            assert "t1_degC" in terminal.shown()
            assert "{" not in terminal.shown()


def test_watch_says_which_axis_answers_where_the_one_asked_for_does_not():
    with published() as (_, endpoint):
        words = ("watch", "--connect", endpoint, "--machine", "lathe-8", "--seconds")
        instead = "answers lathe-7/z, not lathe-8/*"
        done = run_observer(*words, "1")
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == f"observer: at {endpoint} {instead}; name it with --machine and --axis\n"
        with Terminal("-m", "observer", *words, "60") as terminal:
            until(lambda: instead in terminal.shown())


def test_watch_shows_whatever_a_hostile_publisher_sends():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    rng, ended = random.Random(3), threading.Event()
    values = [None, True, 10**400, "[/red]\x1b[2J", [[]], {"a": {}}, 1e308, -1]

    def document() -> bytes:
        keys = ("sources", "quality", "state", "reasons", "temperature_degC", "sigma_K", "sensors", "hash")
        made = {key: rng.choice([*values, {"nut": {"heat_W": rng.choice(values)}}]) for key in keys}
        texts = [json.dumps(made), "NaN", "[" * 50_000, '{"sources":', "9" * 5000]
        return rng.choice([text.encode() for text in texts] + [rng.randbytes(300)])

    with zenoh.open(session_config("router", (), (endpoint,))) as router:

        def attack() -> None:
            while not ended.wait(0.002):
                router.put(f"ballscrew/demo/x/{rng.choice(SHOWN)}", document())

        thread = threading.Thread(target=attack)
        thread.start()
        try:
            done = run_observer("watch", "--connect", endpoint, "--seconds", "4")
        finally:
            ended.set()
            thread.join()
    assert done.returncode in (0, 2)  # 2: nothing but rubbish was heard last
    assert "Traceback" not in done.stderr
    assert "\x1b" not in done.stdout
