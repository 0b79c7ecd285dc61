"""`python -m observer.outlets`, as the service starts it."""

from observer.process.memory import import_sparingly

import_sparingly()

from observer.outlets.process import main  # noqa: E402  (what the line above is for)

main()
