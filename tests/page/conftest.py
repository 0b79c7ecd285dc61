"""A browser for the tests of a file; one that lives longer would keep asyncio from the tests of other files."""

import pytest

from tests.page.browser import chromium


@pytest.fixture(scope="module")
def browser():
    with chromium() as started:
        yield started
