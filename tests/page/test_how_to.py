"""What the page on the page has its reader do, so that others may look from another computer."""

from __future__ import annotations

import ssl
import subprocess
import tomllib
from pathlib import Path

import httpx
import pytest

from tests.docs.console import blocks
from tests.page.served import served_page

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "page.md"


@pytest.mark.system
def test_others_log_in_with_the_files_that_are_made_as_the_page_shows(tmp_path):
    (script,) = [body for _, language, body in blocks(PAGE) if language == "sh"]
    subprocess.run(["sh", "-ec", script], cwd=tmp_path, check=True, capture_output=True)
    tables = [tomllib.loads(body)["page"] for _, language, body in blocks(PAGE) if language == "toml"]
    (table,) = [table for table in tables if "users_file" in table]
    files = {key: tmp_path / table[key] for key in ("users_file", "certificate", "key")}
    name, password = files["users_file"].read_text(encoding="utf-8").strip().split(":")
    with served_page(files["certificate"], **files) as (url, _):
        own = {"origin": url.rstrip("/")}
        trusted = ssl.create_default_context(cafile=files["certificate"])
        with httpx.Client(base_url=url, verify=trusted) as client:
            assert client.get("/").headers["location"] == "/login"
            wrong = client.post("/login", data={"user": name, "password": "wrong"}, headers=own)
            assert wrong.status_code == 403
            client.post("/login", data={"user": name, "password": password}, headers=own)
            assert client.get("/recent.json").status_code == 200
        with pytest.raises(httpx.ConnectError, match="certificate verify failed"):
            httpx.get(url)
        with pytest.raises(httpx.TransportError):
            httpx.get(url.replace("https://", "http://"))
