"""`python -m observer.archive`, as service and gateway start it: answers queries until its input closes."""

from observer.process.memory import import_sparingly

import_sparingly()

from observer.archive.worker import main  # noqa: E402  (what the line above is for)

main()
