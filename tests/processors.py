"""The numeric tests as four generations of processors round them: `make processors`.

OpenBLAS, numpy, the C library and this program's kernels each have code for several generations of x86-64.
Their results differ in the last bits. A test that depends on those bits, as one that counts iterations,
passes on one computer and fails on another. Environment variables choose the code of each generation, and
`PROBE` reports which code runs.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from typing import NamedTuple

NUMERIC = (
    "align", "bits", "config/effects", "control", "estimate", "estimators", "export", "fit", "forecast",
    "gap", "history", "integrity", "kernels", "model", "physics", "quality", "reference", "rods", "truth",
)  # fmt: skip
"""The folders of tests whose results depend on rounding."""
OPTIONS = ("-m", "not system and not slow", "-n", "2", "--dist", "worksteal", "-p", "no:benchmark", "-q")


class Processor(NamedTuple):
    """A generation of processors: the kernel of OpenBLAS, what that needs in numpy's words, the code of numpy
    that it lacks, the kernels of this program, and the code of the C library that it lacks.
    """

    openblas: str
    needs: str = "X86_V2"
    numpy_lacks: tuple[str, ...] = ()
    kernels: str = "avx2"
    libc_lacks: str = ""


_NO_AVX512 = ("X86_V4", "AVX512_ICL", "AVX512_SPR")
_NO_AVX2 = {"numpy_lacks": ("X86_V3", *_NO_AVX512), "kernels": "any", "libc_lacks": "-AVX2,-FMA"}
# OpenBLAS takes Haswell's kernel for AMD's Zen too.
PROCESSORS = {
    "AVX-512": Processor("SkylakeX", "X86_V4"),
    "AVX2": Processor("Haswell", "X86_V3", _NO_AVX512),
    "AVX": Processor("Sandybridge", "X86_V3", **_NO_AVX2),
    "SSE4.2": Processor("Nehalem", **_NO_AVX2),
}

PROBE = """
import ctypes, json, pathlib
import numpy, scipy.linalg
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from observer.kernels import WAY

cores = []
for line in pathlib.Path("/proc/self/maps").read_text().splitlines():
    if "libscipy_openblas" in line and " 00000000 " in line:
        library = ctypes.CDLL(line.split()[-1])
        name = "scipy_openblas_get_corename"
        core = getattr(library, name + "64_" if hasattr(library, name + "64_") else name)
        core.restype = ctypes.c_char_p
        cores.append(core().decode())
print(json.dumps([cores, [name for name in __cpu_dispatch__ if __cpu_features__[name]], WAY]))
"""


def environment(processor: Processor, numpy_has: list[str]) -> dict[str, str]:
    """The environment of a process that computes as that processor, where numpy could use `numpy_has`."""
    chosen = {
        "OPENBLAS_CORETYPE": processor.openblas,
        "OBSERVER_KERNELS": processor.kernels,
        # numpy warns of what this processor lacks anyway
        "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in processor.numpy_lacks if name in numpy_has),
    }
    if processor.libc_lacks:
        chosen["GLIBC_TUNABLES"] = f"glibc.cpu.hwcaps={processor.libc_lacks}"
    return os.environ | {name: value for name, value in chosen.items() if value}


def probe(variables: dict[str, str]) -> tuple[list[str], list[str], str]:
    """The kernels of OpenBLAS, numpy's and scipy's, the code of numpy and this program's kernels."""
    done = subprocess.run([sys.executable, "-c", PROBE], env=variables, stdout=subprocess.PIPE, check=True)
    cores, numpy_has, kernels = json.loads(done.stdout)
    return cores, numpy_has, kernels


def passes(name: str, numpy_has: list[str], arguments: list[str]) -> bool:
    """Whether the tests pass on the processor of that name, and run on nothing else."""
    processor, since = PROCESSORS[name], time.monotonic()
    variables = environment(processor, numpy_has)
    cores, found, kernels = probe(variables)
    if (
        cores != 2 * [processor.openblas]
        or set(found) & set(processor.numpy_lacks)
        or kernels != processor.kernels
    ):
        print(f"{name}: not as asked: OpenBLAS {cores}, numpy {found}, kernels {kernels}", flush=True)
        return False
    done = subprocess.run([sys.executable, "-m", "pytest", *OPTIONS, *arguments], env=variables, check=False)
    result = "FAILED" if done.returncode else "passed"
    print(f"{name}: {result} after {time.monotonic() - since:.0f} s", flush=True)
    return not done.returncode


def main(arguments: list[str]) -> int:
    """Run the numeric tests on each processor that this one can imitate; return 1 after a failure."""
    if platform.machine() != "x86_64":
        print(f"no choice of processors on {platform.machine()}: `make test` is all there is")
        return 0
    numpy_has = ["X86_V2", *probe(dict(os.environ))[1]]
    for name, processor in PROCESSORS.items():
        if processor.needs not in numpy_has:
            print(f"{name}: left out, this processor is older", flush=True)
        elif not passes(name, numpy_has, arguments or [f"tests/{folder}" for folder in NUMERIC]):
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
