"""Which C compiler builds the kernels, and for which processor.

`setup.py` calls `prepare`. As the build backend that pyproject.toml names, this is setuptools with one
requirement more: on a computer without a C compiler a build fetches zig's as a package, so that nobody has to
install one first.

KERNELS_TARGET=aarch64-linux-gnu.2.28 in the environment builds for that processor, that system and that
version of its C library, by zig wherever it runs: this is how a release's wheels are made (`make wheels`).
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  what is not defined below is setuptools' own


def prepare() -> str:
    """Have setuptools call the compiler there is; returns the processor built for, as `x86_64` or `aarch64`.

    Ends with a sentence where Python's headers are missing.
    """
    include = sysconfig.get_path("include")
    if not Path(include, "Python.h").exists():
        sys.exit(
            f"The kernels cannot be built: the Python of {sys.base_prefix} has no headers, "
            f"{include}/Python.h is missing. Install them (Debian and Ubuntu: python3-dev, Fedora: "
            "python3-devel), take a Python that brings them, or install a wheel, which needs neither headers "
            "nor a compiler."
        )
    machine = _target().partition("-")[0]
    if machine:
        # setuptools goes by it; given from outside, it would have the installer fetch a zig of that processor
        os.environ["_PYTHON_HOST_PLATFORM"] = f"linux-{machine}"
    if compiler := _compiler():
        os.environ["CC"] = compiler
        # Python's own linker flags are for its own compiler: zig refuses some of Debian's
        os.environ.setdefault("LDSHARED", f"{compiler} -shared")
    # what zig makes of the C library; a build may have no home to keep it in
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(Path("build", "zig").resolve()))
    return machine or platform.machine()


def get_requires_for_build_wheel(config_settings=None):  # type: ignore[no-untyped-def]
    """What a wheel needs beside what pyproject.toml lists."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *_zig()]


def get_requires_for_build_editable(config_settings=None):  # type: ignore[no-untyped-def]
    """What an editable installation needs beside what pyproject.toml lists."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *_zig()]


def _zig() -> list[str]:
    """The package of zig's compiler, where it is the one that would be called."""
    return ["ziglang>=0.17"] if "ziglang" in (_compiler() or "") else []


def _target() -> str:
    """The processor, system and C library that are built for; empty for those of this computer."""
    return os.environ.get("KERNELS_TARGET", "")


def _compiler() -> str | None:
    """The command of the C compiler; None for the one that Python was built with, which setuptools takes."""
    zig = f"{shlex.quote(sys.executable)} -m ziglang cc"
    if target := _target():
        return f"{zig} -target {target}"
    if named := os.environ.get("CC"):
        return named
    own = shlex.split(sysconfig.get_config_var("CC") or "")[:1]
    found = next((name for name in (*own, "cc", "gcc", "clang") if shutil.which(name)), None)
    if found is not None:
        return None if [found] == own else found
    # without -mcpu, zig compiles for the very processor it runs on
    return f"{zig} -mcpu=baseline"
