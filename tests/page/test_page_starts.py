"""Where the page's server cannot begin, and what it says then."""

from __future__ import annotations

import socket
import subprocess

import pytest

from observer.config.outlets import Page
from observer.errors import ConfigError
from observer.outlets.messages import Latest
from observer.outlets.page import serve
from observer.outlets.start import Start
from tests.bus.people import Authority
from tests.bus.router import free_port


async def test_a_port_that_is_taken_is_a_reason_in_words():
    said = []
    with socket.create_server(("127.0.0.1", 0)) as other:
        listen = f"127.0.0.1:{other.getsockname()[1]}"
        start = Start(machine="lathe", axis="z", period_s=60.0, page=Page(listen=listen))
        with pytest.raises(OSError, match=f"another program listens on {listen}"):
            await serve(start, Latest(60.0), said.append)
    assert said == []


@pytest.mark.parametrize("wrong", ["other key", "encrypted key", "no PEM"])
async def test_a_certificate_that_cannot_be_used_is_a_reason_in_words(tmp_path, wrong):
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
    page = Page(listen=f"127.0.0.1:{free_port()}", **files)
    start = Start(machine="lathe", axis="z", period_s=60.0, page=page)
    with pytest.raises(ConfigError, match="cannot be used as a certificate"):
        await serve(start, Latest(60.0), lambda _: None)
