"""Two processes that share a search's work: the same answer to the bit, and what they exchange."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from observer.discovery.search import without
from observer.discovery.workers import IN_PROCESS, WorkerPool, _packed, _problems, _unpacked
from observer.fit.hypothesis import fit_null
from tests.discovery.small import problem_of
from tests.logs.machines import machine
from tests.logs.simulated import made_log

ROOT = Path(__file__).parents[2]
SEARCHED_TWICE = """
from observer.discovery.discover import discover
from observer.discovery.workers import WorkerPool
from tests.logs.machines import machine
from tests.logs.simulated import made_log

config = machine()
truth = machine(effect=[{"kind": "sensor_bias", "target": "b", "offset_K": 0.8}])
logs = [[made_log(truth, seed, minutes=60.0)] for seed in range(3)]
alone = discover(config, logs)
with WorkerPool() as pool:
    shared = discover(config, logs, pool=pool)
assert alone.verdict.kind == shared.verdict.kind == "named"
assert alone.verdict.fit.values.tolist() == shared.verdict.fit.values.tolist()
assert [t.score for t in alone.search.ranking] == [t.score for t in shared.search.ranking]
"""


def test_a_second_process_does_not_change_the_answer() -> None:
    """In a process whose BLAS sums in one order: OpenBLAS's kernels for AVX-512 let it depend on where arrays
    lie in memory, which moves the last bits.
    """
    kernels = os.environ | {"OPENBLAS_CORETYPE": "Haswell"}
    done = subprocess.run(
        [sys.executable, "-c", SEARCHED_TWICE],
        cwd=ROOT,
        env=kernels,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_what_crosses_over_leaves_the_problem_behind() -> None:
    config = machine()
    null = fit_null(problem_of(config, [made_log(config, 0, minutes=20.0)]), config)
    _problems[:] = [null.problem]
    data = _packed((without, null))
    work, fit = _unpacked(data)
    assert work is without
    assert fit.problem is null.problem
    assert fit.deviance == null.deviance
    assert len(data) < 5 * null.residual.nbytes * (1 + null.jacobian.shape[1])


def test_alone_one_does_all_in_order() -> None:
    config = machine()
    problem = problem_of(config, [made_log(config, 0, minutes=20.0)])
    assert IN_PROCESS.map(lambda _problem, x, y: x - y, problem, [(3, 1), (5, 5), (1, 9)]) == [2, 0, -8]


def test_who_works_for_another_process_has_no_second_one_of_its_own() -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(_has_another).result() is False


def _has_another() -> bool:
    with WorkerPool() as pool:
        return pool._other is not None
