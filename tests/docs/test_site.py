"""The site that `make docs` builds: complete, no link broken, nothing fetched from another computer."""

from __future__ import annotations

import functools
import http.server
import re
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
NAVIGATION = tomllib.loads((ROOT / "zensical.toml").read_text("utf-8"))["project"]["nav"]
PAGES = [p for p in sorted((ROOT / "docs").rglob("*.md")) if "decisions" not in p.parts]
SIZES = [(390, 844), (768, 1024), (1280, 800), (1920, 1080)]


def _pages(entry: Any) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
    else:
        for part in entry if isinstance(entry, list) else entry.values():
            yield from _pages(part)


def test_every_page_but_the_decisions_is_in_the_navigation_once() -> None:
    named = sorted(_pages(NAVIGATION))
    assert len(set(named)) == len(named)
    assert {str(p.relative_to(ROOT)) for p in PAGES} <= set(named)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it, in a folder of the test's own."""
    place = tmp_path_factory.mktemp("site")
    shutil.copy(ROOT / "zensical.toml", place)  # a link to it would build beside what it leads to
    (place / "observer").symlink_to(ROOT / "observer")
    recipe = (ROOT / "Makefile").read_text("utf-8")
    copied = re.search(r"^SITE := (.*)$", recipe, re.M)
    assert copied
    for name in copied[1].split():
        target = place / "build" / "site-source" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, target)
    program = Path(sys.executable).parent / "zensical"
    done = subprocess.run(
        [program, "build", "--clean", "--strict"], cwd=place, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (place / "build" / "site" / "index.html").exists()
    return place / "build" / "site"


@pytest.mark.system
def test_the_site_reads_and_searches_without_another_computer(site: Path) -> None:
    if shutil.which("chromium") is None:
        pytest.skip("needs Debian's package chromium")
    from playwright.sync_api import sync_playwright

    with _Served(site) as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page()
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            for path in ("/", "/docs/tutorial/", "/docs/gallery/", "/docs/reference/configuration/"):
                page.goto(address + path)
                wide = page.evaluate(
                    "document.documentElement.scrollWidth - document.documentElement.clientWidth"
                )
                assert wide <= 0, f"{path} is {wide} px wider than a window of {width} px"
        page.goto(address)
        page.get_by_role("button", name="Search").first.click()
        page.get_by_role("combobox").fill("preload")
        page.get_by_role("option").filter(has_text="preload").first.wait_for()
        browser.close()
    assert all(url.startswith(address) for url in asked)


class _Served:
    def __init__(self, folder: Path) -> None:
        handler = functools.partial(_Quiet, directory=str(folder))
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)

    def __enter__(self) -> str:
        threading.Thread(target=self._server.serve_forever).start()
        return f"http://127.0.0.1:{self._server.server_port}"

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Say nothing."""
