"""One axis of several: `observer run` in a process of its own, which ends with the one that started it."""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

from observer.errors import UserError
from observer.process.memory import import_sparingly
from observer.process.shutdown import leave


def main() -> None:
    """Serve one configuration; arguments are its path, `text` or `json`, and seconds or nothing."""
    path, log_format, seconds = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    import_sparingly()
    from observer.daemon import serve
    from observer.installation import load
    from observer.process.messages import configure

    try:
        config = load(path)
        configure(as_json=log_format == "json", axis=f"{config.machine.name}/{config.machine.axis}")
        serve(config, float(seconds) if seconds else None, path)
    except UserError as error:
        print(f"observer: {error}", file=sys.stderr)
        leave(2)
    leave(0)


def _end_with_parent() -> None:
    """Standard input closes when the parent ends, whatever ended it."""
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
