"""A browser for the tests of one file: it keeps asyncio from others while it lives."""

import pytest

from tests.page.browser import chromium


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started
