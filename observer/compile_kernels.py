"""Compiles into the cache what a configuration's service needs; the configuration comes as a line of JSON."""

from __future__ import annotations

import os
import sys
import threading

from observer.installation import Installation
from observer.service.align import Aligner
from observer.service.machine import Machine
from observer.service.open_loop import OpenLoop


def main() -> None:
    """Compile, and end at once when the service that waits for it has ended."""
    config = Installation.model_validate_json(sys.stdin.readline())
    threading.Thread(target=_end_with_parent, daemon=True).start()
    machine = Machine.of(config, learns=True)
    frame = Aligner(machine.plan).tick(0.0)
    machine.pipeline(machine.estimator()).warm_up(frame)
    OpenLoop(machine.plant, machine.drive).warm_up(frame)


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # the thread that waits for the parent holds standard input
