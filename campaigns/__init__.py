"""Campaigns and long measurements: each is a target of `make`, or a module with a `main`.

They run the product on the simulated machines of `tests`; the functions that judge the results are themselves
tested there. `tests` comes first because it sets the threads and instructions of OpenBLAS, before numpy is
loaded.
"""

import tests  # noqa: F401
