"""The page by TLS, with a certificate of a plant's own authority: who trusts it, and who logs in over it."""

from __future__ import annotations

import ssl
import subprocess

import httpx
import pytest

from observer.page.login import COOKIE
from tests.gateway.telling import told_gateway
from tests.page.browser import CHROMIUM, chromium
from tests.page.gateway import gateway
from tests.patience import until
from tests.publish.people import Authority, secret
from tests.publish.router import free_port

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A page by TLS for those who log in: its address, and the authority's certificate."""
    folder = tmp_path_factory.mktemp("tls")
    ours = Authority(folder)
    users = secret(folder / "users", "anna:right\n")
    with gateway(ours.ca, users_file=users, **ours.sign("page")) as (url, _):
        yield url, ours.ca


def test_who_trusts_the_authority_logs_in_and_out_over_it(served):
    url, ca = served
    own = {"origin": url.rstrip("/")}
    with httpx.Client(base_url=url, verify=ssl.create_default_context(cafile=ca)) as client:
        assert client.get("/").headers["location"] == "/login"
        wrong = client.post("/login", data={"user": "anna", "password": "wrong"}, headers=own)
        assert wrong.status_code == 403
        assert "set-cookie" not in wrong.headers
        right = client.post("/login", data={"user": "anna", "password": "right"}, headers=own)
        assert right.headers["location"] == "/"
        words = {word.strip() for word in right.headers["set-cookie"].split(";")}
        assert {"Secure", "HttpOnly", "SameSite=Strict", "Path=/"} <= words
        assert client.get("/recent.json").status_code == 200
        out = client.post("/logout", headers=own)
        assert f"{COOKIE}=;" in out.headers["set-cookie"]
        assert "Secure" in out.headers["set-cookie"]
        assert client.get("/recent.json").status_code == 401


def test_who_does_not_trust_it_and_who_speaks_plainly_gets_nothing(served):
    url, _ = served
    with pytest.raises(httpx.ConnectError, match="certificate verify failed"):
        httpx.get(url)
    with pytest.raises(httpx.TransportError):
        httpx.get(url.replace("https://", "http://"))


@pytest.mark.skipif(not CHROMIUM.exists(), reason="needs Debian's package chromium")
def test_a_browser_shows_the_page_over_it(served):
    url, _ = served
    with chromium() as browser:
        page = browser.new_page(ignore_https_errors=True)  # it trusts its own authorities only
        page.goto(url)
        page.fill("[name=user]", "anna")
        page.fill("[name=password]", "right")
        page.keyboard.press("Enter")
        page.wait_for_selector("tr[data-sensor=t3]")  # that came by the stream of events
        (cookie,) = page.context.cookies()
        assert cookie["secure"]
        assert page.evaluate("() => isSecureContext")
        page.click("#logout button")
        page.wait_for_selector("[name=password]")
        assert page.locator(".plain").count() == 0


@pytest.mark.parametrize("wrong", ["other key", "encrypted key", "no PEM"])
def test_a_certificate_that_cannot_be_used_is_a_reason_in_words(tmp_path, wrong):
    ours = Authority(tmp_path)
    files = ours.sign("page")
    if wrong == "other key":
        files["key"] = ours.sign("other")["key"]
    elif wrong == "no PEM":
        files["certificate"].write_text("wrong", encoding="utf-8")
    else:
        locked = tmp_path / "locked.key"
        subprocess.run(
            ["openssl", "pkey", "-in", files["key"], "-aes256", "-passout", "pass:secret", "-out", locked],
            check=True, capture_output=True,
        )  # fmt: skip
        files["key"] = locked
    settings = {"listen": f"127.0.0.1:{free_port()}", **files}
    with told_gateway(page=settings) as teller:
        until(lambda: "cannot be used as a certificate" in (teller.said()["reason"] or ""))
