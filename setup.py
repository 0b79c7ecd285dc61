"""Builds the kernels: the files of `observer/kernels` as one extension, which the compiler sees as a whole.

Each file is written in Python; the header of the same name gives the types (Cython's augmenting `.pxd`).
They are put one behind the other, without their imports of each other, and Cython does the rest. Records are
what kernels take for NamedTuples of the package: headers list their typed fields, and their classes are made
here, and numpy's types of the structures of `states.pxd`. On x86-64 the same C code is compiled twice, for
any such processor and for one with AVX2.

KERNELS_CHECKED=1 in the environment builds them for tests instead: every index is checked, and one out of
bounds is an IndexError. This build runs some times slower, on any processor.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import os
import re
import shutil
from pathlib import Path

from Cython.Build import cythonize
from Cython.Compiler import Options
from setuptools import Extension, setup

from build_kernels import prepare

_spec = importlib.util.spec_from_file_location("files", "observer/kernels/files.py")  # without the package
files = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(files)

KERNELS = Path("observer/kernels")
BUILD = Path("build/kernels")
CHECKED = os.environ.get("KERNELS_CHECKED", "") == "1"
RECORDS = ("states", "records", "tick_records")
PARTS = (
    "codes", "covariance", "coupling", "exact_step", "advance", "judging", "screening", "learning", "step",
    "kalman", "fixed_gain", "smoother", "bank", "changes", "sweep", "path",
    "walk", "selftest", "message", "live",
)  # fmt: skip
HEAD = f"""# cython: language_level=3, boundscheck={CHECKED}, wraparound=False, cdivision=True, cpow=True
# cython: infer_types=True, initializedcheck=False, embedsignature=False, auto_pickle=False
import cython
from cython.cimports.libc.math import (
    INFINITY, M_PI, NAN, cos, exp, expm1, floor, fmod, isfinite, isinf, isnan, log, lrint, rint, sin, sqrt
)
from cython.cimports.cpython.bytes import PyBytes_AsString, PyBytes_FromStringAndSize
from cython.cimports.libc.string import memcpy


@cython.cfunc
def bytes_of(octets: cython.uchar[::1], count: cython.Py_ssize_t):
    return PyBytes_FromStringAndSize(cython.cast(cython.p_char, cython.address(octets[0])), count)


@cython.cfunc
def take_bytes(octets: cython.uchar[::1], data: bytes):
    memcpy(cython.address(octets[0]), PyBytes_AsString(data), octets.shape[0])


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def float_at(data: cython.p_const_char, at: cython.Py_ssize_t) -> cython.double:
    value: cython.double
    memcpy(cython.address(value), data + at, 8)
    return value


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def octet_at(data: cython.p_const_char, at: cython.Py_ssize_t) -> cython.Py_ssize_t:
    return data[at]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def put_float32(octets: cython.uchar[::1], at: cython.Py_ssize_t, value: cython.double) -> cython.void:
    short: cython.float = cython.cast(cython.float, value)
    memcpy(cython.address(octets[at]), cython.address(short), 4)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def put_float64(octets: cython.uchar[::1], at: cython.Py_ssize_t, value: cython.double) -> cython.void:
    i: cython.Py_ssize_t
    octet: cython.p_uchar = cython.cast(cython.p_uchar, cython.address(value))
    for i in range(8):
        octets[at + i] = octet[7 - i]
"""
RECORD = """

class Record:
    def __init__(self, **fields):
        for name, value in fields.items():
            setattr(self, name, value)
"""
HEADER_HEAD = "cimport cython\n"
# No multiplication and addition in one rounding, nor anything else that changes a bit between processors.
FLAGS = [
    "-O1" if CHECKED else "-O3",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fvisibility=hidden",
    "-g0",
    "-w",
]
LIMITED = [("Py_LIMITED_API", "0x030B0000"), ("NDEBUG", None)]
# What the headers call inline is: a call copies a view of an array, 136 bytes, for each that it hands on.
INLINED = [] if CHECKED else [("CYTHON_INLINE", "inline __attribute__((always_inline))")]


def fields_of(header: str) -> dict[str, list[tuple[str, str, int | tuple[()]]]]:
    """Return the numbers of each structure in a header, as numpy describes them."""
    return {
        name: [
            (field, "f8", int(size) if size else ())
            for size, fields in re.findall(r"^    double(?:\[(\d+)\])? (.+)$", body, re.M)
            for field in fields.split(", ")
        ]
        for name, body in re.findall(r"^cdef struct (\w+):\n((?:    .+\n)+)", header, re.M)
    }


def join(build: Path) -> Path:
    """Write all parts into one file and one header below `build`; return the file."""
    headers = {part: (KERNELS / f"{part}.pxd").read_text("utf-8") for part in ("vector", *RECORDS, *PARTS)}
    records = re.findall(r"^cdef class (\w+)\((\w+)\):", "".join(headers[part] for part in RECORDS), re.M)
    structures = fields_of(headers["states"])
    names = {name for name, _ in records} | set(structures)
    code = [HEAD, RECORD, *(f"\nclass {name}({base}):\n    pass\n" for name, base in records)]
    for part in PARTS:
        text = (KERNELS / f"{part}.py").read_text("utf-8")
        tree = ast.parse(text)
        lines = text.splitlines(keepends=True)
        for node in tree.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                lines[node.lineno - 1 : node.end_lineno] = ["\n"] * (node.end_lineno - node.lineno + 1)
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                if node.name in names:
                    raise SystemExit(f"observer/kernels: two functions are called {node.name}")
                names.add(node.name)
        code.append("".join(lines))
    folder = build / "observer/kernels"
    folder.mkdir(parents=True, exist_ok=True)
    for package in (folder, folder.parent):
        (package / "__init__.py").touch()
    joined = folder / "core.py"
    header = [HEADER_HEAD, *headers.values()]
    digest = hashlib.sha256("".join(code + header).encode()).hexdigest()
    code.append(f"STATES = {structures}")
    code.append(f'FILES = "{files.digest(KERNELS)}"  # as `observer.kernels` has it of those beside it\n')
    code.append(f'MADE_OF = "{digest}"  # tests ask whether these are the files that they have before them\n')
    for path, text in ((joined, "\n".join(code)), (joined.with_suffix(".pxd"), "\n".join(header))):
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")
    return joined


def extensions() -> list[Extension]:
    """The kernels for any processor, and for one with AVX2 from the same C code."""
    machine = prepare()
    Options.buffer_max_dims = 5  # one more than any array has: views of arrays are handed on by value
    joined = join(BUILD)
    options = {"define_macros": LIMITED + INLINED, "py_limited_api": True}
    (any_cpu,) = cythonize(
        [Extension("observer.kernels.core", [str(joined)], extra_compile_args=FLAGS, **options)],
        include_path=[str(BUILD)],
    )
    kinds = [any_cpu]
    if CHECKED:  # a function that ends with an error returns 0, which is no value of a vector register's type
        source = Path(any_cpu.sources[0])
        text = source.read_text("utf-8")
        source.write_text(
            text.replace("\n  __pyx_r = 0;", "\n  memset(&__pyx_r, 0, sizeof(__pyx_r));"), "utf-8"
        )
    elif machine == "x86_64":
        (KERNELS / "avx2").mkdir(exist_ok=True)
        again = BUILD / "avx2" / "core.c"  # the same, under a name of its own: both are compiled at once
        again.parent.mkdir(exist_ok=True)
        shutil.copyfile(any_cpu.sources[0], again)
        kinds.append(
            Extension(
                "observer.kernels.avx2.core",
                [str(again)],
                extra_compile_args=[*FLAGS, "-mavx2", "-mtune=haswell"],
                **options,
            )
        )
    return kinds


setup(
    ext_modules=extensions(),
    options={"bdist_wheel": {"py_limited_api": "cp311"}, "build_ext": {"parallel": True}},
)
