"""What strangers do to the real server of the page, and what it answers."""

from __future__ import annotations

import gzip
import json
import socket
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from tests.page.served import served_page
from tests.patience import PATIENCE_S, until

pytestmark = pytest.mark.system
NO_BODY = (
    b"POST /acknowledge HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\nContent-Length: 9\r\n\r\n"
)
GUESSES = 90  # more would make room for each other


def _asked(url: str, path: str, form: str | None = None, **headers: str) -> httpx.Response:
    """What is answered, without following where it leads."""
    own = {"Origin": url.rstrip("/"), **headers}
    method = "GET" if form is None else "POST"
    return httpx.request(method, f"{url[:-1]}{path}", content=form, headers=own, timeout=PATIENCE_S)


def _users(folder: Path) -> Path:
    path = folder / "users"
    path.write_text("anna:right\n", encoding="utf-8")
    path.chmod(0o600)
    return path


@contextmanager
def _held(url: str, count: int, data: bytes):
    """Connections that have sent something and wait."""
    place = urlsplit(url)
    connections = [socket.create_connection((place.hostname, place.port)) for _ in range(count)]
    try:
        for connection in connections:
            connection.sendall(data)
        yield connections
    finally:
        for connection in connections:
            connection.close()


def test_of_many_guesses_at_once_five_are_looked_at(tmp_path):
    body = b"user=anna&password=wrong"
    with served_page(users_file=_users(tmp_path)) as (url, _):
        place = urlsplit(url).netloc
        head = f"POST /login HTTP/1.1\r\nHost: {place}\r\nOrigin: http://{place}\r\n".encode()
        head += b"Connection: close\r\nContent-Length: %d\r\n\r\n" % len(body)
        with _held(url, GUESSES // 2, head + body[:-1]) as some, _held(url, GUESSES // 2, head) as others:
            # a request that is answered shows that the heads before it have been taken
            assert _asked(url, "/login").status_code == 200
            for connection in some:
                connection.sendall(body[-1:])
            for connection in others:
                connection.sendall(body)
            answers = [connection.recv(65536).split(b" ")[1:2] for connection in (*some, *others)]
        assert answers.count([b"403"]) == 5
        assert _asked(url, "/login", "user=anna&password=right").status_code == 429


def test_who_does_not_finish_his_request_keeps_nobody_out_and_is_closed():
    with served_page() as (url, _), ExitStack() as held:
        unfinished = (b"GET / HTTP/1.1\r\nHost: 127", b"", NO_BODY)  # half a head, nothing, no body
        connections = [c for data in unfinished for c in held.enter_context(_held(url, 140, data))]
        assert _asked(url, "/").status_code == 200
        until(lambda: all(_is_closed(connection) for connection in connections))


def _is_closed(connection: socket.socket) -> bool:
    try:
        while connection.recv(65536, socket.MSG_DONTWAIT):
            pass
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def test_a_cookie_that_has_been_logged_out_is_worth_nothing(tmp_path):
    with served_page(users_file=_users(tmp_path)) as (url, _):
        kept, other = [
            _asked(url, "/login", "user=anna&password=right").headers["Set-Cookie"].split(";")[0]
            for _ in "12"
        ]
        assert _asked(url, "/recent.json", Cookie=kept).status_code == 200
        assert _asked(url, "/logout", "", Cookie=kept).status_code == 303
        assert _asked(url, "/recent.json", Cookie=kept).status_code == 401
        assert _asked(url, "/recent.json", Cookie=other).status_code == 200


HOSTILE = [
    (f"/assets/{'a' * 5000}", None, 404),
    ("/history.json?from=0&to=1e308", None, 400),
    ("/history.json?from=-1e308&to=1e308", None, 400),
    ("/history.json?from=0&to=5e-324", None, 400),
    ("/acknowledge", "&".join(["a=1"] * 900), 400),
    ("/acknowledge", "id=" + "a" * 5000, 413),
]


def test_a_hostile_request_is_rejected_with_a_sentence():
    with served_page() as (url, _):  # which also asserts that nothing is on standard error
        for path, form, status in HOSTILE:
            answer = _asked(url, path, form)
            assert answer.status_code == status, (path, form)
            assert answer.text.strip()
        assert _asked(url, "/acknowledge", "id=a", Origin="http://[").status_code == 403


def test_a_burst_of_viewers_is_admitted_up_to_the_limit():
    with (
        served_page() as (url, _),
        _held(url, 110, b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n") as viewers,
    ):
        statuses = [_status(connection) for connection in viewers]
        assert 1 <= statuses.count(b"200") <= 60
        for connection in viewers:
            connection.close()
        with httpx.Client(timeout=PATIENCE_S) as client:

            def is_admitted() -> bool:  # those who have gone make room
                with client.stream("GET", f"{url}events") as answer:
                    return answer.status_code == 200

            until(is_admitted)


def _status(connection: socket.socket) -> bytes:
    """The status of an answer, nothing where the connection is reset.

    A server that is held up takes all connections before it reads a request; of more than 100 the oldest go.
    """
    try:
        return connection.recv(65536)[9:12]
    except ConnectionResetError:
        return b""


def test_sixty_viewers_who_ask_for_the_last_hour_at_once_get_it_compressed_once():
    request = (
        b"GET /recent.json HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept-Encoding: gzip\r\nConnection: close\r\n\r\n"
    )
    with served_page() as (url, _), _held(url, 60, request) as viewers:
        answers = [b"".join(iter(lambda c=c: c.recv(65536), b"")) for c in viewers]
        bodies = {answer.partition(b"\r\n\r\n")[2] for answer in answers}
        assert len(bodies) == 1
        document = json.loads(gzip.decompress(bodies.pop()))
        assert {"every_s", "rows", "keys", "appearance"} == document.keys()
        assert httpx.get(f"{url}recent.json", headers={"accept-encoding": "identity"}).json() == document
