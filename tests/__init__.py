"""Tests of the Ballscrew Observer; they mirror the packages.

OpenBLAS takes the same code on every processor that has AVX2, so that all of them give the same bits.
"""

import os
import platform
from pathlib import Path

_cpu = Path("/proc/cpuinfo")
if platform.machine() == "x86_64" and _cpu.exists() and "avx2" in _cpu.read_text(encoding="utf-8"):
    os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
