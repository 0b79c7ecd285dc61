"""A publisher in a process of its own, to be harmed; it ends when its standard input closes."""

import sys

from tests.bus.blocks import block
from tests.bus.people import published


def main() -> None:
    with published(history=200) as (made, endpoint):
        made.document("compensation", {"armed": False})
        for k in range(200):
            made.publish(block(), k)
        made.document("health", {"state": "good"})
        print(endpoint, flush=True)
        for _ in sys.stdin:  # each line asks how things are
            print(made.status.alive, len(made.commands()), flush=True)


if __name__ == "__main__":
    main()
