"""Tests of the Ballscrew Observer; they mirror the packages.

OpenBLAS takes the same code on every processor that has AVX2, so that all of them give the same bits, and one
thread, as in the product: numpy often comes before it here, and a campaign's searches would wait for each
other's threads.
"""

import os
import platform
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
_cpu = Path("/proc/cpuinfo")
if platform.machine() == "x86_64" and _cpu.exists() and "avx2" in _cpu.read_text(encoding="utf-8"):
    os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
