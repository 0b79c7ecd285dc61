"""The reduced plant is read back by other programs' readers, and is the plant."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import scipy.io
from scipy.linalg import expm

from observer.export.model import plant_matrices, write_mat, write_npz, write_plant_json
from tests.export.made import nut_machine


def test_every_format_reads_back_the_same(tmp_path: Path) -> None:
    found = plant_matrices(nut_machine())
    npz = np.load(tmp_path / write_npz(found, tmp_path))
    mat = scipy.io.loadmat(tmp_path / write_mat(found, tmp_path), squeeze_me=True)
    text = json.loads((tmp_path / write_plant_json(found, tmp_path)).read_text())
    for name, value in found.items():
        if isinstance(value, np.ndarray):
            for other in (npz[name], mat[name], np.array(text[name])):
                assert np.array_equal(other, value), name
        else:
            assert npz[name].tolist() == text[name] == value
            assert np.array(mat[name]).tolist() == value
    assert found["configuration"] == nut_machine().digest


def test_the_exported_plant_is_one_in_continuous_and_discrete_time() -> None:
    """Ad and Bd are what the matrix exponential makes of A and B; at rest all is as warm as the air."""
    found = plant_matrices(nut_machine())
    n, m, p = len(found["A"]), found["B"].shape[1], found["E"].shape[1]
    whole = np.zeros((n + m + p, n + m + p))
    whole[:n] = np.hstack([found["A"], found["B"], found["E"]])
    exact = expm(whole * found["period_s"])
    np.testing.assert_allclose(found["Ad"], exact[:n, :n], atol=1e-12)
    np.testing.assert_allclose(found["Bd"], exact[:n, n : n + m], atol=1e-12)
    np.testing.assert_allclose(found["Ed"], exact[:n, n + m :], atol=1e-12)
    z = np.full(p, 17.0)
    at_rest = found["C"] @ np.linalg.solve(found["A"], -found["E"] @ z) + found["F"] @ z
    for name, unit, value in zip(found["outputs"], found["output_units"], at_rest, strict=True):
        assert name.endswith(unit)
        np.testing.assert_allclose(value, 17.0 if unit == "degC" else 0.0, atol=1e-6)
