"""Who may look: names, passwords, cookies, and how often somebody may be wrong."""

from __future__ import annotations

import pytest

from observer.errors import ConfigError
from observer.files.regular import read_users
from observer.outlets.page_guard import Logins


def _file(folder, text: str, mode: int = 0o600):
    path = folder / "users"
    path.write_text(text, encoding="utf-8")
    path.chmod(mode)
    return path


def test_a_file_of_users_gives_names_and_passwords(tmp_path):
    users = read_users(_file(tmp_path, "anna:a:b\n\nben:c\n"), "page.users_file")
    assert users == {"anna": "a:b", "ben": "c"}


@pytest.mark.parametrize(
    ("text", "mode", "reason"),
    [
        ("anna\n", 0o600, "line 1"),
        ("anna:a\n:b\n", 0o600, "line 2"),
        ("\n", 0o600, "names no user"),
        ("anna:a\n", 0o644, "chmod 600"),
    ],
)
def test_an_unusable_file_of_users_is_rejected_with_a_sentence(tmp_path, text, mode, reason):
    with pytest.raises(ConfigError, match=reason):
        read_users(_file(tmp_path, text, mode), "page.users_file")


def test_a_missing_file_is_rejected_with_a_sentence(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        read_users(tmp_path / "none", "page.users_file")


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def _login(clock: Clock, *, secure: bool = False) -> Logins:
    return Logins({"anna": "right"}, secure=secure, clock=clock)


def _value(header: str) -> str:
    return header.split(";", maxsplit=1)[0].partition("=")[2]


def test_a_cookie_is_worth_its_name_until_it_is_too_old():
    clock = Clock()
    login = _login(clock)
    cookie = _value(login.cookie("anna"))
    assert login.user_of(cookie) == "anna"
    clock.now_s = 12 * 3600 + 1
    assert login.user_of(cookie) is None


@pytest.mark.parametrize(
    "change", [lambda c: c[:-1] + "x", lambda c: "f" + c[1:], lambda c: "", lambda c: "a.b"]
)
def test_a_cookie_that_is_not_ours_is_worth_nothing(change):
    login = _login(Clock())
    assert login.user_of(change(_value(login.cookie("anna")))) is None
    assert _login(Clock()).user_of(_value(login.cookie("anna"))) is None


@pytest.mark.parametrize("secure", [False, True])
def test_a_cookie_is_for_the_page_alone_and_for_tls_where_there_is_any(secure):
    login = _login(Clock(), secure=secure)
    for header in (login.cookie("anna"), login.no_cookie()):
        words = set(header.split("; "))
        assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= words
        assert ("Secure" in words) == secure


def test_five_wrong_passwords_make_an_address_wait_for_a_minute():
    clock = Clock()
    login = _login(clock)
    for name in ("anna", "nobody", "anna", "anna", "anna"):
        assert not login.is_throttled("here")
        assert not login.is_right(name, "wrong", "here")
    assert login.is_throttled("here")
    assert not login.is_throttled("there")
    clock.now_s = 61.0
    assert not login.is_throttled("here")
    assert login.is_right("anna", "right", "here")
