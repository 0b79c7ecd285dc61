"""A fresh environment with the wheel of `dist/` and what that needs, as the lock pins it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_LONGEST_S = 900.0  # fetching and unpacking some hundred packages


@dataclass(frozen=True, slots=True)
class Installed:
    """An environment by its folder."""

    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    def runs(self, *words: str, at: Path, code: int = 0) -> str:
        """Run a program of the environment in a folder; returns what was printed on both outputs."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        done = subprocess.run(
            [str(self.folder / "bin" / words[0]), *words[1:]],
            cwd=at, env=kept, capture_output=True, text=True, timeout=_LONGEST_S,
        )  # fmt: skip
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr


def install_wheel(folder: Path) -> Installed:
    """Make the environment. Skips the test where no wheel was built, or there is no uv."""
    wheels = sorted((ROOT / "dist").glob("*.whl"))
    if not wheels:
        pytest.skip("dist/ holds no wheel; `make dist` builds it")
    own = ROOT / "build" / "uv" / "bin" / "uv"
    uv = str(own) if own.exists() else shutil.which("uv")
    if uv is None:
        pytest.skip("there is no uv; `make dist` installs it")
    pins = folder / "pins.txt"
    lines = (ROOT / "requirements-dev.lock").read_text(encoding="utf-8").splitlines()
    pins.write_text("\n".join(line.removesuffix(" \\") for line in lines if "==" in line), encoding="utf-8")
    place = folder / "environment"
    subprocess.run([uv, "venv", "--quiet", "--python", sys.executable, str(place)], check=True)
    wanted = [f"ballscrew-observer[all] @ {wheels[-1].as_uri()}", "ipykernel", "pandas", "xarray"]
    subprocess.run(
        [uv, "pip", "install", "--quiet", "--python", str(place / "bin" / "python"),
         "--constraint", str(pins), *wanted],
        check=True, timeout=_LONGEST_S,
    )  # fmt: skip
    return Installed(place)
