"""What holds for all tests: the kernels are compiled before the first of them, the long ones come first."""

from __future__ import annotations

from pathlib import Path

import pytest

DEMO = Path(__file__).parents[1] / "config" / "demo.toml"


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long tests, the others in their random order: two workers then end together."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Fill the cache of compiled kernels once, in the process that starts the others.

    On a fresh checkout of a busy computer this takes longer than any test may, and two workers would do it
    twice.
    """
    if hasattr(session.config, "workerinput") or session.config.option.collectonly:
        return
    # Imported here, because a worker's import of the product belongs to its tests.
    from observer import installation
    from observer.history.smoother import smooth_heats
    from observer.service.align import Aligner
    from observer.service.machine import Machine

    settings = installation.load(DEMO)
    for kind in ("kalman", "luenberger"):
        estimator = settings.estimator.model_copy(update={"kind": kind})
        machine = Machine.of(settings.model_copy(update={"estimator": estimator}), learns=True)
        machine.pipeline(machine.estimator()).warm_up(Aligner(machine.plan).tick(0.0))
    _, nothing = machine.drive.run(machine.drive.initial(), Aligner(machine.plan).tick(0.0))
    smooth_heats(machine.plant, settings.estimator, [nothing])
