"""The other process of the transport's benchmark: notes when each message arrives, prints it at the end.

Prints "ready", then, once a message comes on the key `end`, one JSON object {key: [monotonic ns, …]}.
"""

from __future__ import annotations

import json
import sys
import time

import zenoh

from observer.bus.session import session_config


def main() -> None:
    """Subscribe to `<prefix>/**` at an endpoint, both given as arguments."""
    endpoint, prefix = sys.argv[1:3]
    arrivals: dict[str, list[int]] = {}
    with zenoh.open(session_config("client", (endpoint,), ())) as session:
        subscriber = session.declare_subscriber(f"{prefix}/**", zenoh.handlers.FifoChannel(4096))
        print("ready", flush=True)
        for sample in subscriber:
            now_ns = time.monotonic_ns()
            key = str(sample.key_expr).rsplit("/", 1)[1]
            if key == "end":
                break
            arrivals.setdefault(key, []).append(now_ns)
    print(json.dumps(arrivals), flush=True)


if __name__ == "__main__":
    main()
