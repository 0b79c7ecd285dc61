"""What holds for all tests: the long ones come first."""

from __future__ import annotations

import pytest


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long tests, the others in their random order: two workers then end together."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
