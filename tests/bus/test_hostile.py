"""Whatever a client sends, it is answered with an error or not at all, and the service goes on as before."""

import json
import os
import subprocess
import sys
import threading

import pytest
import structlog
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.bus.answers import Budget, Responder
from observer.bus.codec import decode
from observer.bus.session import service_config, session_config
from observer.config.publishing import Publish
from tests.bus.blocks import block
from tests.bus.people import PREFIX, ask, published, session
from tests.patience import until as wait

KEYS = ("config", "estimate", "health", "compensation", "command/arm", "command/disarm", "command/reset")
WILD = ("**", "ballscrew/**", f"{PREFIX}/*", f"{PREFIX}/**", f"{PREFIX}/command/*", "ballscrew/*/*/estimate")
GROWTH_MB = 50.0
COUNT = int(os.environ.get("HOSTILE_QUERIES", "200"))  # `make hostile` asks ten thousand
_NUMBERS = ["9" * 5000, "-1", "0", "1e5", "٣", "²", "1_0", " 7", "999999", "99999999", "0x10", "", "nan"]
_TEXTS = [*_NUMBERS, "yes", "ab12", "ab12\0", "%00", "\u202e", "=", "x" * 60_000, "\x1b[2J", "a=b", "]", '"']
_NAMES = ["last", "arm", "config", "by", "_time", "_anyke", "", "x" * 300]

_keys = (
    st.sampled_from(KEYS).map(lambda key: f"{PREFIX}/{key}") | st.sampled_from(WILD) | st.text(max_size=20)
)
_pair = st.builds("{}={}".format, st.sampled_from(_NAMES), st.sampled_from(_TEXTS) | st.text(max_size=30))
_bytes = st.none() | st.binary(max_size=200) | st.sampled_from([100, 65_000, 70_000, 1_000_000]).map(bytes)
_attempts = st.tuples(_keys, st.lists(_pair, max_size=4).map(";".join), _bytes, _bytes, st.booleans())


def _resident_MB(process: int | str = "self") -> float:
    with open(f"/proc/{process}/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _attempt(opened: zenoh.Session, key: str, words: str, payload, attachment, forges: bool) -> None:
    """One query, or one forged message; what comes back is an answer or a refusal of bearable length."""
    try:
        if forges:
            opened.put(key, payload or b"")
            return
        replies = opened.get(f"{key}?{words}", payload=payload, attachment=attachment, timeout=0.3)
    except (zenoh.ZError, UnicodeEncodeError):
        return  # not even a selector
    for reply in replies:
        if reply.err is not None:
            assert len(reply.err.payload.to_bytes()) < 500
        else:
            assert b'"done"' not in reply.ok.payload.to_bytes()


class _Victim:
    """A publisher in a process of its own."""

    def __enter__(self):
        command = [sys.executable, "-m", "tests.bus.victim"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.endpoint = self._process.stdout.readline().strip()
        return self

    def __exit__(self, *_):
        self._process.stdin.close()
        try:
            assert self._process.wait(20) == 0
        finally:
            self._process.kill()
            self._process.stdout.close()

    def state(self) -> str:
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self._process.stdout.readline().strip()

    def resident_MB(self) -> float:
        return _resident_MB(self._process.pid)


@pytest.mark.system
@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_hostile_queries():
    with _Victim() as victim, session(victim.endpoint) as honest, session(victim.endpoint) as hostile:
        for key in KEYS * 20:  # what is allocated once is no growth
            _attempt(hostile, f"{PREFIX}/{key}", "last=200", bytes(60_000), None, False)
        before_MB = victim.resident_MB()

        @settings(max_examples=COUNT, database=None)
        @given(_attempts)
        def attack(attempt):
            _attempt(hostile, *attempt)

        attack()
        grown_MB = victim.resident_MB() - before_MB
        print(f"{COUNT} attempts, {grown_MB:.1f} MB more")
        assert grown_MB < GROWTH_MB
        alive, commands = victim.state().split()
        assert alive == "True"
        assert int(commands) <= 4
        wait(lambda: json.loads(ask(honest, f"{PREFIX}/health")[0]).get("state") == "good")


@pytest.mark.system
@pytest.mark.parametrize("last", [*_NUMBERS[:3], *_NUMBERS[4:6], "x", "1.5"])
def test_an_invalid_number_does_no_harm(last):
    with published(history=5) as (made, endpoint), session(endpoint) as opened:
        made.publish(block(), 0)
        (refused,) = ask(opened, f"{PREFIX}/estimate?last={last}")
        assert "give a whole number from 1 to 999999" in refused
        assert len(refused) < 200
        opened.get(f"{PREFIX}/estimate?last=3", timeout=1)
        (reply,) = opened.get(f"{PREFIX}/estimate?last=3", timeout=5)
        assert len(decode(reply.ok.payload.to_bytes())) == 1
        assert made.status.alive


@pytest.mark.system
def test_payloads_of_a_hundred_megabytes_are_not_kept():
    with published() as (made, endpoint), session(endpoint) as opened:
        made.document("health", {})
        payload = bytes(100_000_000)
        before_MB = _resident_MB()
        for _ in range(3):
            assert ask(opened, f"{PREFIX}/health", payload=payload) == ["! Timeout"]
        del payload
        assert _resident_MB() < before_MB + GROWTH_MB
        wait(lambda: ask(opened, f"{PREFIX}/health") == ['{"sequence":null,"sensors_used":0,"sensors":2}'])


@pytest.mark.system
def test_a_client_that_asks_too_much_has_to_wait_and_others_are_served():
    with (
        published(history=2000) as (made, endpoint),
        session(endpoint) as greedy,
        session(endpoint) as modest,
    ):
        for k in range(2000):
            made.publish(block(), k)
        many = [greedy.get(f"{PREFIX}/estimate?last=999999", timeout=5) for _ in range(400)]
        replies = [reply for asked in many for reply in asked]
        words = [r.err.payload.to_string() for r in replies if r.err]
        assert any("too many requests at once" in word for word in words)
        wait(lambda: json_of(modest) == '{"hash":"ab12"}')


def json_of(opened) -> str:
    return ask(opened, f"{PREFIX}/config")[0]


@pytest.mark.system
def test_a_client_that_does_not_read_its_answers_holds_up_nobody():
    with published(history=5000) as (made, endpoint), session(endpoint) as honest:
        for k in range(5000):
            made.publish(block(), k)
        gate = threading.Event()
        with zenoh.open(session_config("client", (endpoint,), ())) as deaf:
            block_all = zenoh.handlers.Callback(lambda _: gate.wait(20), indirect=False)
            for _ in range(40):
                deaf.get(f"{PREFIX}/estimate?last=5000", block_all, timeout=20)
            wait(lambda: json_of(honest) == '{"hash":"ab12"}')
            gate.set()
        assert made.status.alive
    stalled = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    assert json.loads(service_config(Publish()).get_json(stalled)) == 1_000_000  # Zenoh's own: five seconds


class _Query:
    """A query that is not what it should be: whatever is asked of it raises."""

    def __init__(self, error: type[BaseException]) -> None:
        self._error = error

    def __enter__(self):
        raise self._error("made to fail")

    def __getattr__(self, name: str):
        raise self._error("made to fail")


@given(st.sampled_from([ValueError, RuntimeError, RecursionError, zenoh.ZError, OSError, MemoryError]))
def test_a_defect_in_an_answer_is_logged_and_the_next_one_given(error):
    class Channel:
        def __init__(self) -> None:
            self.waiting = [_Query(error), _Query(error)]

        def try_recv(self):
            return self.waiting.pop() if self.waiting else None

    channel = Channel()
    answers = Responder("ballscrew/m/x", b'{"hash":"h"}', 5, "0a0a0a0a")
    with structlog.testing.capture_logs() as logs:
        answers.answer({"config": channel, "command/arm": channel})
    assert channel.waiting == []
    assert [entry["event"] for entry in logs] == ["a query could not be answered"]


def test_a_budget_comes_back_with_time():
    now_s = [0.0]
    budget = Budget(100.0, lambda: now_s[0])
    assert not budget.is_spent()
    budget.spend(250)
    assert budget.is_spent()
    now_s[0] = 1.4
    assert budget.is_spent()
    now_s[0] = 1.6
    assert not budget.is_spent()
    now_s[0] = 1000.0
    budget.is_spent()
    budget.spend(100)
    assert budget.is_spent()


@pytest.mark.system
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_dies_all_the_same_shows():
    with published() as (made, _):
        assert made.status.alive

        def die(_):
            raise SystemExit  # what no handler of exceptions holds

        made._answers.answer = die
        wait(lambda: not made.status.alive)
        assert "the thread that answers has died; restart the service" in made.status.reason
