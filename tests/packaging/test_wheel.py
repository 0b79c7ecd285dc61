"""The wheel alone, in a fresh environment: the demo, a replay of what it recorded, and the notebooks."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from tests.bus.router import free_port
from tests.packaging.installed import Installed, install_wheel
from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.slow, pytest.mark.system]
NOTEBOOKS = sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return install_wheel(tmp_path_factory.mktemp("wheel"))


def test_the_package_is_that_of_the_wheel(installed: Installed, tmp_path: Path) -> None:
    said = installed.runs("python", "-c", "import observer; print(observer.__file__)", at=tmp_path)
    assert str(installed.folder) in said
    assert (Path(said.strip()).parent / "py.typed").exists()
    assert version("ballscrew-observer") in installed.runs("observer", "--version", at=tmp_path)


def test_the_demo_runs_by_itself(installed: Installed, tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    said = installed.runs(
        "observer", "demo", "--seconds", "15", "--plain", "--no-page", "--listen", endpoint, at=tmp_path
    )
    assert "nut" in said


def test_a_log_is_replayed_by_the_packaged_configuration(installed: Installed, tmp_path: Path) -> None:
    config = installed.folder / "share" / "ballscrew-observer" / "demo.toml"
    rows = ["time_s,t1_degC,t2_degC,t3_degC,t4_degC,t5_degC,nut_position_m,screw_speed_rpm"]
    rows += [f"{t},22.0,22.1,22.0,21.9,22.0,{0.2 + 0.001 * t},0" for t in range(120)]
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    words = ("--config", str(config), "--output", "out")
    said = installed.runs("observer", "replay", "log.csv", *words, at=tmp_path)
    assert "written to out" in said
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["rows"] > 0


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs(path: Path, installed: Installed, tmp_path: Path) -> None:
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    assert all(not cell.get("outputs") for cell in book.cells), "outputs are not committed"
    kernels = tmp_path / "kernels"
    (kernels / "wheel").mkdir(parents=True)
    command = [str(installed.python), "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    about = {"argv": command, "display_name": "wheel", "language": "python"}
    (kernels / "wheel" / "kernel.json").write_text(json.dumps(about))
    client = NotebookClient(book, timeout=20 * PATIENCE_S, resources={"metadata": {"path": str(tmp_path)}})
    client.create_kernel_manager()
    client.km.kernel_spec_manager.kernel_dirs = [str(kernels)]
    client.km.kernel_name = "wheel"
    client.execute()
    text = json.dumps(book)
    assert "image/png" in text or path.stem != "first-estimate", "the picture is not shown"
    assert "end_conduction right" in text or path.stem != "missing-effect"
