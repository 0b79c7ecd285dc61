"""Who is not named does nothing, a viewer only looks, an operator commands, and nobody forges the service."""

import contextlib
import json
import stat
import subprocess
import tomllib
from functools import partial
from pathlib import Path

import pytest
import zenoh
from pydantic import ValidationError

from observer.bus.ask import Address, ask_health, command
from observer.bus.exchange import Outcome
from observer.bus.session import client_config, service_config
from observer.config.publishing import Client, Publish
from observer.errors import ConfigError
from tests.bus.blocks import block
from tests.bus.people import PREFIX, Authority, ask, published, secret, session, user
from tests.docs.console import blocks
from tests.patience import until as wait

ROLES = {"viewer": ["user:anna"], "operator": ["user:oskar"], "service": ["user:cell"]}
PASSWORDS = {"anna": "see", "oskar": "do", "cell": "be"}
HEALTH = {"sequence": None, "sensors_used": 0, "sensors": 2, "state": "good"}
COMMAND = f"{PREFIX}/command/reset?config=ab12"


def _users(folder: Path) -> dict:
    lines = "".join(f"{name}:{password}\n" for name, password in PASSWORDS.items())
    return {"login": {"users_file": secret(folder / "users", lines)}, "access": ROLES}


def _is_obeyed(made, opened) -> bool:
    """Whether the one command that a client asks for is handed over, and its outcome reported."""
    replies = opened.get(COMMAND, timeout=10)
    (command,) = wait(lambda: [c for c in made.commands() if c.refused is None])
    command.answer(Outcome(True, "as asked", 1.0))
    return command.kind == "reset" and [json.loads(r.ok.payload.to_bytes())["done"] for r in replies] == [
        True
    ]


def _may_only_look(opened) -> bool:
    """Whether a client is told the configuration, and gets no answer to a command."""
    (config,) = ask(opened, f"{PREFIX}/config")
    return json.loads(config)["hash"] == "ab12" and all(a == "! Timeout" for a in ask(opened, COMMAND))


@pytest.mark.system
def test_a_viewer_by_password_only_looks_and_an_operator_commands(tmp_path):
    with published(**_users(tmp_path)) as (made, endpoint):
        made.document("health", {"state": "good"})

        def person(name, password=None):
            return session(endpoint, user(tmp_path, name, password or PASSWORDS[name]))

        for stranger in (None, user(tmp_path, "anna", "wrong"), user(tmp_path, "nobody", "see")):
            with pytest.raises(zenoh.ZError), session(endpoint, stranger):
                pass
        with person("anna") as anna, person("oskar") as oskar:
            heard = [s.declare_subscriber(f"{PREFIX}/**") for s in (anna, oskar)]
            _publish_until(made, lambda: all(h.try_recv() for h in heard))
            for opened in (anna, oskar):
                assert json.loads(ask(opened, f"{PREFIX}/config")[0])["hash"] == "ab12"
                assert json.loads(ask(opened, "ballscrew/*/*/health")[0]) == HEALTH
                alive = opened.liveliness().get("ballscrew/*/*/alive", timeout=3)
                assert [str(r.ok.key_expr) for r in alive] == [f"{PREFIX}/alive"]
                for wildcard in ("ballscrew/**", f"{PREFIX}/**", "**"):
                    assert all(a == "! Timeout" for a in ask(opened, f"{wildcard}?config=ab12"))
            assert _may_only_look(anna)
            assert made.commands() == []
            assert _is_obeyed(made, oskar)


def _publish_until(made, condition):
    def once():
        made.publish(block(), 0)
        return condition()

    wait(once)


@pytest.mark.system
def test_only_a_service_may_publish_or_answer_on_the_keys(tmp_path):
    with published(**_users(tmp_path)) as (made, endpoint), contextlib.ExitStack() as stack:
        people = {
            name: stack.enter_context(session(endpoint, user(tmp_path, name, word)))
            for name, word in PASSWORDS.items()
        }
        readers = {
            name: people[name].declare_subscriber(f"{PREFIX}/heat", zenoh.handlers.FifoChannel(1000))
            for name in ("anna", "oskar")
        }
        liar = people["anna"].declare_queryable(f"{PREFIX}/forged")

        def forge(*names):
            for name in names:
                people[name].put(f"{PREFIX}/heat", f"forged by {name}")

        def heard(name):
            made.publish(block(), 0)
            sample = readers[name].try_recv()
            return sample and sample.payload.to_string()

        for name, other in (("anna", "oskar"), ("oskar", "anna")):
            wait(partial(heard, name))
            forge(other)
            for _ in range(20):  # what was forged before would have come by then
                assert f"forged by {other}" not in wait(partial(heard, name))
        assert all(a == "! Timeout" for a in ask(people["oskar"], f"{PREFIX}/forged"))
        assert liar.try_recv() is None
        wait(lambda: forge("cell") or heard("anna") == "forged by cell")  # it may


@pytest.mark.system
def test_a_viewer_by_certificate_only_looks_and_an_operator_commands(tmp_path):
    plant, other = Authority(tmp_path), Authority(tmp_path, "other")
    tls = {"ca": plant.ca, **plant.sign("service"), "client_certificates": True}
    access = {"viewer": ["certificate:grafana"], "operator": ["certificate:panel"]}

    def person(ca, own=None):
        return session(endpoint, Client.model_validate({"tls": {"ca": ca, **(own or {})}}))

    with published("tls", tls=tls, access=access) as (made, endpoint):
        strangers = ((plant.ca, None), (plant.ca, other.sign("panel")), (other.ca, plant.sign("panel")))
        for ca, own in strangers:
            with pytest.raises(zenoh.ZError), person(ca, own):
                pass
        with pytest.raises(zenoh.ZError), session(endpoint.replace("tls/", "tcp/")):
            pass
        with person(plant.ca, plant.sign("visitor")) as visitor:  # let in, but not named
            assert all(a == "! Timeout" for a in ask(visitor, f"{PREFIX}/config"))
        with person(plant.ca, plant.sign("grafana")) as grafana:
            assert _may_only_look(grafana)
        assert made.commands() == []
        with person(plant.ca, plant.sign("panel")) as panel:
            assert _is_obeyed(made, panel)


@pytest.mark.system
def test_the_programs_own_commands_log_in_as_whom_they_are_given(tmp_path):
    with published(**_users(tmp_path)) as (made, endpoint):
        made.document("health", {"state": "good"})
        anna = user(tmp_path, "anna", "see")
        assert ask_health(Address(endpoint, "lathe-7", "z", anna), 10).document == HEALTH
        assert "rejects this client" in ask_health(Address(endpoint, "lathe-7", "z"), 2).problem
        assert command("reset", Address(endpoint, "lathe-7", "z", anna), 2).document is None
        assert made.commands() == []


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"access": {}}, "names nobody"),
        ({"access": {"viewer": ["anna"]}}, "String should match pattern"),
        ({"access": {"viewer": ["user:anna"], "operator": ["user:anna"]}}, "named twice"),
        ({"access": {"viewer": ["user:anna"]}}, "give login.users_file"),
        ({"access": {"viewer": ["certificate:anna"]}}, "set tls.client_certificates"),
        ({"access": {"viewer": ["user:anna"]}, "mode": "client"}, "whose router decides"),
        (
            {"access": ROLES, "login": {"users_file": "u"}, "connect": ["tcp/10.0.0.1:7447"]},
            "shut out the router",
        ),
        ({"login": {"user": "anna", "password": "see"}}, "does not belong in a configuration"),
        ({"login": {"user": "anna"}}, "user and password_file belong together"),
        ({"tls": {"certificate": "a.pem"}, "listen": ["tls/[::]:1"]}, "certificate and key belong together"),
        ({"tls": {"client_certificates": True}, "listen": ["tls/[::]:1"]}, "give ca"),
        ({"tls": {"ca": "a.pem"}}, "no endpoint"),
        ({"tls": {"ca": "a.pem"}, "listen": ["tls/[::]:1"]}, "needs a certificate"),
        ({"tls": {"ca": "a.pem"}, "connect": ["tcp/10.0.0.1:1"]}, "is not encrypted"),
        ({"listen": ["tls/[::]:7447"]}, r"give \[publish.tls\]"),
    ],
)
def test_a_table_that_would_be_ineffective_is_rejected(settings, words):
    with pytest.raises(ValidationError, match=words):
        Publish.model_validate(settings)


def test_files_with_secrets_belong_to_one_person(tmp_path):
    def login(**keys):
        return service_config(Publish.model_validate({"login": keys}))

    word, users = secret(tmp_path / "word", "see\n"), secret(tmp_path / "users", "anna:see\n")
    login(user="anna", password_file=word, users_file=users)
    for file, key in ((word, "password_file"), (users, "users_file")):
        file.chmod(0o640)
        with pytest.raises(
            ConfigError, match=rf"{key}: .* can be read by others \(mode 0640\); run chmod 600"
        ):
            login(user="anna", password_file=word, users_file=users)
        file.chmod(0o600)
    word.write_text(" \n")
    with pytest.raises(ConfigError, match="is empty; write the password"):
        login(user="anna", password_file=word)


def test_certificates_are_looked_at_before_anything_starts(tmp_path):
    plant = Authority(tmp_path)
    own, another = plant.sign("service"), plant.sign("another")

    def tls(**keys):
        return client_config(("tls/127.0.0.1:1",), Client.model_validate({"tls": {"ca": plant.ca} | keys}))

    tls(**own)
    with pytest.raises(ConfigError, match=r"tls.certificate: no usable PEM file"):
        tls(certificate=own["certificate"], key=another["key"])
    with pytest.raises(ConfigError, match=r"tls.ca: no usable PEM file"):
        tls(ca=own["key"])
    own["key"].chmod(0o644)
    assert stat.S_IMODE(own["key"].stat().st_mode) == 0o644
    with pytest.raises(ConfigError, match=r"tls.key: .* can be read by others"):
        tls(**own)


PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "control-access.md"


def _page(tmp_path: Path, monkeypatch) -> list[dict]:
    """Do in a folder what the page on access control has its reader do; returns its TOML blocks."""
    monkeypatch.chdir(tmp_path)
    found = blocks(PAGE)
    for script in (body for _, language, body in found if language == "sh"):
        subprocess.run(["sh", "-ec", script], check=True, capture_output=True)
    here = [body.replace("/etc/ballscrew-observer/", "") for _, language, body in found if language == "toml"]
    return [tomllib.loads(body) for body in here]


@pytest.mark.system
def test_the_page_on_access_control_does_what_it_says(tmp_path, monkeypatch):
    by_certificate, panel, by_password, panel_by_password = _page(tmp_path, monkeypatch)
    secret(tmp_path / "users", "anna:see\npanel:do\n")
    secret(tmp_path / "panel.password", "do\n")
    anna = {"tls": {"ca": "plant.pem", "certificate": "anna.pem", "key": "anna.key"}}
    secret(tmp_path / "anna.password", "see")
    anna_by_password = {
        "tls": panel_by_password["tls"],
        "login": {"user": "anna", "password_file": "anna.password"},
    }
    for service, operator, viewer in (
        (by_certificate, panel, anna),
        (by_password, panel_by_password, anna_by_password),
    ):
        settings = {k: v for k, v in service["publish"].items() if k not in ("mode", "listen")}
        with published("tls", **settings) as (made, endpoint):
            with pytest.raises(zenoh.ZError), session(endpoint):
                pass
            with session(endpoint, Client.model_validate(viewer)) as opened:
                assert _may_only_look(opened)
            assert made.commands() == []
            with session(endpoint, Client.model_validate(operator)) as opened:
                assert _is_obeyed(made, opened)
