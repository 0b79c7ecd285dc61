"""`observer` with a computer's clock that somebody sets forward by an hour, a while after the start.

The service reads its clock through `time.time`; no process can step the real one. Arguments: those of
`observer run --config C …`. The step comes when a file named `step` appears beside C.
"""

import sys
import time
from pathlib import Path

from observer.cli import main

STEP_S = 3600.0
_true_time = time.time
_here = Path(sys.argv[3]).parent


def _stepped() -> float:
    return _true_time() + (STEP_S if (_here / "step").exists() else 0.0)


time.time = _stepped

if __name__ == "__main__":
    main()
