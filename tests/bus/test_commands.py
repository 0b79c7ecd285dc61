"""Commands reach the loop by their exact key and the configuration's hash only, and say what was done."""

import contextlib
import json
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from observer.bus import ask as asking
from observer.bus.exchange import Outcome, plain_name
from observer.bus.session import session_config
from tests.bus.people import PREFIX, ask, published, session
from tests.bus.router import free_port
from tests.patience import PAUSE_S
from tests.patience import until as wait
from tests.system.plant import run_observer

HASH = "config=ab12"


def _asked(made, opened, selector):
    """What a query is answered while a loop carries out every command that reaches it; and those commands."""
    taken = []
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(ask, opened, selector)
        while not answer.done():
            for command in made.commands():
                taken.append(command)
                if command.refused is None:
                    command.answer(Outcome(True, "as asked", 12.5))
        return answer.result(), taken


@pytest.mark.system
def test_a_command_is_handed_over_and_its_outcome_reported():
    with published() as (made, endpoint), session(endpoint) as opened:
        for kind in ("arm", "disarm", "reset"):
            (answer,), (command,) = _asked(made, opened, f"{PREFIX}/command/{kind}?{HASH};by=anna@desk")
            assert (command.kind, command.by, command.refused) == (kind, "anna@desk", None)
            assert json.loads(answer) == {
                "command": kind, "done": True, "text": "as asked", "time_s": 12.5, "instance": "0a0a0a0a"
            }  # fmt: skip


@pytest.mark.system
@pytest.mark.parametrize(
    "selector",
    [
        f"ballscrew/**?{HASH}",
        "ballscrew/**?arm=yes",
        f"ballscrew/*/*/command/*?{HASH}",
        f"{PREFIX}/command/*?{HASH}",
        f"{PREFIX}/command/a$*?{HASH}",
        f"ballscrew/*/z/command/arm?{HASH}",
        f"{PREFIX}/compensation?arm=yes",
        f"{PREFIX}/compensation?arm=yes;{HASH}",
    ],
)
def test_a_wildcard_and_the_old_form_command_nothing(selector):
    with published() as (made, endpoint), session(endpoint) as opened:
        made.document("compensation", {"armed": False})
        answers, taken = _asked(made, opened, selector)
        assert taken == []
        assert not any('"done"' in answer for answer in answers)
        assert any("command" in answer for answer in answers if answer.startswith("!"))


@pytest.mark.system
@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ("", "add config=HASH"),
        ("?arm=yes", "add config=HASH"),
        ("?config=", "that is not in force"),
        ("?config=ab1", "that is not in force"),
        ("?config=ab12%20", "that is not in force"),
    ],
)
def test_a_command_for_another_configuration_is_refused_and_recorded(parameters, words):
    with published() as (made, endpoint), session(endpoint) as opened:
        (answer,), taken = _asked(made, opened, f"{PREFIX}/command/arm{parameters}")
        assert answer.startswith("! ")
        assert words in answer
        assert all(command.refused for command in taken)


@pytest.mark.system
def test_without_a_configuration_nothing_is_obeyed():
    with published(digest="") as (made, endpoint), session(endpoint) as opened:
        answers, taken = _asked(made, opened, f"{PREFIX}/command/reset?config=")
        assert answers[0].startswith("! ")
        assert all(command.refused for command in taken)


@pytest.mark.system
def test_at_most_four_commands_wait_and_more_are_refused():
    with published() as (made, endpoint), session(endpoint) as opened:
        many = [opened.get(f"{PREFIX}/command/reset?{HASH}", timeout=5) for _ in range(12)]
        refused = [r for replies in many[4:] for r in replies if r.err]
        assert refused
        assert all("too many commands are waiting" in r.err.payload.to_string() for r in refused)
        assert 1 <= len(made.commands()) <= 4


def test_the_name_of_who_asks_is_fit_for_a_log():
    assert plain_name("anna@desk-7.plant") == "anna@desk-7.plant"
    assert plain_name('a;b=c,"d"\n!e') == "a_b_c__d___e"
    assert len(plain_name("x" * 10_000)) == 64


@given(st.binary(max_size=200) | st.recursive(st.none() | st.floats() | st.text(), st.lists).map(
    lambda value: json.dumps(value).encode()
))  # fmt: skip
def test_an_answer_of_any_bytes_is_an_object_or_a_sentence(data):
    answer = asking.answer_of(data)
    assert (answer.document is None) == bool(answer.problem)
    assert answer.document is None or isinstance(answer.document, dict)
    assert asking.refusal_of(data).isprintable()


class _Liar:
    """A queryable on every key of the axis that gives a fixed answer."""

    def __init__(self, endpoint: str, data: bytes) -> None:
        self._session = zenoh.open(session_config("router", (), (endpoint,)))
        self._queries = self._session.declare_queryable("ballscrew/**", zenoh.handlers.FifoChannel(64))
        self._data = data
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._answer)
        self._thread.start()

    def _answer(self) -> None:
        while not self._ended.wait(0.005):
            while (query := self._queries.try_recv()) is not None:
                with query:
                    query.reply(query.key_expr, self._data)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._session.close()


@pytest.mark.system
@pytest.mark.parametrize(
    "data",
    [
        b"", b"{", b"[]", b"null", b"17", b"\xff\xfe", b"9" * 5000, b"[" * 100_000, b'"text"', b"{}",
        b'{"hash": 5}', b'{"hash": "ab;arm=yes"}', b'{"hash": "\\u001b[2J"}',
        b'{"done": 1, "state": ["good"]}', b'{"hash": "ab12", "done": "yes"}', b"x" * 2_000_000,
    ],
    ids=lambda data: data[:20].decode("latin-1"),
)  # fmt: skip
def test_whatever_comes_back_an_asker_gets_an_answer_in_words(data):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    liar = _Liar(endpoint, data)
    try:
        health = asking.ask_health(asking.Address(endpoint, "lathe-7", "z"), 5)
        assert health.problem or isinstance(health.document, dict)
        armed = asking.command("arm", asking.Address(endpoint, "lathe-7", "z"), 5)
        assert armed.problem or armed.document.get("done") is not True
    finally:
        liar.close()


@pytest.mark.parametrize(
    ("state", "quality", "gives"),
    [
        ("good", "good", True),
        ("degraded", "good", True),
        ("starting", "starting", True),
        ("starting", "invalid", False),
        ("stale", "stale", False),
        ("invalid", "invalid", False),
        ("good", None, False),
        (["good"], {}, False),
    ],
)
def test_a_service_that_has_estimated_nothing_gives_no_estimates(state, quality, gives):
    assert asking.gives_estimates({"state": state, "quality": quality}) is gives


@pytest.mark.system
def test_a_request_for_a_missing_axis_names_those_that_exist():
    with published() as (made, endpoint):
        made.document("health", {"state": "good"})
        instead = f"at {endpoint} answers lathe-7/z, not lathe-8/{{}}; name it with --machine and --axis"
        assert asking.ask_health(asking.Address(endpoint, "lathe-8", "*"), 1).problem == instead.format("*")
        for digest in (None, "ab12"):
            answer = asking.command("reset", asking.Address(endpoint, "lathe-8", "z"), 1, digest)
            assert answer.problem == instead.format("z")
        assert made.commands() == []


@pytest.mark.system
def test_of_many_axes_that_answer_instead_some_are_named():
    with published() as (_, endpoint), session(endpoint) as other:
        tokens = [other.liveliness().declare_token(f"ballscrew/m{k}/x/alive") for k in range(9)]
        answer = asking.ask_health(asking.Address(endpoint, "lathe-8", "z"), 1)
        names = ", ".join(["lathe-7/z", *(f"m{k}/x" for k in range(7))])
        assert f"answer {names} and 2 more, not lathe-8/z; name one" in answer.problem
        assert len(tokens) == 9


@pytest.mark.system
def test_an_axis_that_lives_and_does_not_answer_is_not_taken_for_another():
    with published() as (_, endpoint), session(endpoint) as other:
        token = other.liveliness().declare_token("ballscrew/lathe-8/z/alive")
        assert "no service answers" in asking.ask_health(asking.Address(endpoint, "lathe-8", "z"), 1).problem
        token.undeclare()


@pytest.mark.system
def test_the_commands_find_the_hash_themselves_or_take_the_one_given():
    with published() as (made, endpoint), ThreadPoolExecutor(1) as pool:
        for digest, done in ((None, True), ("ab12", True), ("ab13", False)):
            answer = pool.submit(
                asking.command, "disarm", asking.Address(endpoint, "lathe-7", "z"), 10, digest
            )
            while not answer.done():
                for command in made.commands():
                    assert "@" in command.by
                    if command.refused is None:
                        command.answer(Outcome(True, "as asked", 1.0))
            found = answer.result()
            assert (found.document is not None and found.document["done"]) is done
            assert done or "that is not in force" in found.problem


@pytest.mark.system
def test_a_compensation_is_there_only_where_it_is_switched_on():
    with published(compensates=False) as (_, endpoint), session(endpoint) as opened:
        assert ask(opened, f"{PREFIX}/compensation") in ([], ["! Timeout"])
    with published() as (made, endpoint), session(endpoint) as opened:
        wait(lambda: ask(opened, f"{PREFIX}/compensation") == ["! no compensation yet"])
        made.document("compensation", {"armed": False})
        assert ask(opened, f"{PREFIX}/compensation") == [
            '{"sequence":null,"sensors_used":0,"sensors":2,"armed":false}'
        ]


@contextlib.contextmanager
def _obedient(*axes: str):
    """Services of these axes at one endpoint that carry out every command, and the commands that they got."""
    taken, ended = [], threading.Event()
    with contextlib.ExitStack() as stack:
        first, endpoint = stack.enter_context(published(axis=axes[0]))
        others = [published(axis=axis, connect=(endpoint,)) for axis in axes[1:]]
        services = [first, *(stack.enter_context(other)[0] for other in others)]

        def carry_out() -> None:
            while not ended.wait(PAUSE_S):
                for service in services:
                    for command in service.commands():
                        taken.append(command)
                        command.answer(Outcome(True, "as asked", 12.5))

        with ThreadPoolExecutor(1) as pool:
            done = pool.submit(carry_out)
            yield endpoint, taken
            ended.set()
            done.result()


@pytest.mark.system
def test_a_command_needs_no_names_where_one_service_answers():
    with _obedient("z") as (endpoint, taken):
        for kind in ("arm", "disarm", "zero", "reset", "acknowledge"):
            done = run_observer(kind, "--connect", endpoint)
            assert done.returncode == 0, done.stdout + done.stderr
        assert run_observer("disarm", "--connect", endpoint, "--axis", "z").returncode == 0
        done = run_observer("arm", "--connect", endpoint, "--without", "right_housing", "--without", "t1,t2")
        assert done.returncode == 0, done.stdout + done.stderr
    assert [command.kind for command in taken] == [
        "arm", "disarm", "zero", "reset", "acknowledge", "disarm", "arm"
    ]  # fmt: skip
    assert taken[0].without == ()
    assert taken[-1].without == ("right_housing", "t1", "t2")


@pytest.mark.system
def test_where_several_services_answer_a_command_lists_them_and_reaches_none():
    with _obedient("x", "z") as (endpoint, taken):
        wait(lambda: "several" in run_observer("reset", "--connect", endpoint).stdout)  # once both have met
        done = run_observer("reset", "--connect", endpoint)
        assert done.returncode == 1
        assert f"several services answer at {endpoint}: lathe-7/x, lathe-7/z; name the one" in done.stdout
        count = len(taken)
        assert run_observer("reset", "--connect", endpoint, "--axis", "x").returncode == 0
        assert len(taken) == count + 1


def test_a_strange_name_of_a_sensor_is_refused_before_anything_is_asked():
    done = run_observer("arm", "--without", "t1;id=x")
    assert done.returncode == 2
    assert "--without: 't1;id=x' is not the name of a sensor" in done.stderr
