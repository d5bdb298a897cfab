"""The wheel works on its own, from another folder, with all shipped files inside."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

import pips_drake
from pips_drake.scene import packages

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*command, str(ROOT)], check=True)
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the wheel; the dependencies are those of this environment.

    Python reads no .pth files in a folder that a .pth file adds, so the checkout, which this
    environment may have as an editable install, stays out of sight.
    """
    folder = tmp_path_factory.mktemp("a folder") / "venv"  # with a space, on purpose
    venv.create(folder, symlinks=True)
    python = folder / "bin/python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps"]
    subprocess.run([*pip, "--no-index", str(wheel)], check=True)
    (site_packages,) = folder.glob("lib/python*/site-packages")
    (site_packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def run(python: Path, code: str, folder: Path) -> str:
    """What the code prints when it runs in an environment and a folder."""
    command = [str(python), "-c", code]
    done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout


def test_wheel_holds_all_shipped_files_and_nothing_beside_the_package(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    folders = ("models", "scenarios", "studies")
    shipped = {
        f"pips_drake/{file.relative_to(ROOT)}"
        for folder in folders
        for file in (ROOT / folder).rglob("*")
        if file.is_file()
    }
    assert "pips_drake/models/package.xml" in shipped
    assert {name for name in names if name.split("/")[1] in folders} == shipped
    assert "pips_drake/py.typed" in names
    assert {name.split("/")[0].partition("-")[0] for name in names} == {"pips_drake"}


def test_installed_package_is_the_wheels(python: Path, tmp_path: Path) -> None:
    code = "import pips_drake; print(pips_drake.__version__, pips_drake.__file__)"
    version, _, file = run(python, code, tmp_path).strip().partition(" ")
    assert version == pips_drake.__version__
    assert Path(file).is_relative_to(python.parents[1])


def test_installed_package_lists_the_same_files(python: Path, tmp_path: Path) -> None:
    kinds = ["arm", "path", "model", "scene", "scenario", "study"]
    code = (
        "import json\n"
        "from pips_drake.scene import packages\n"
        f"names = {{kind: packages.list_names(kind) for kind in {kinds}}}\n"
        "for kind in names:\n"
        "    assert all(packages.find_file(kind, name).is_file() for name in names[kind])\n"
        "print(json.dumps(names))\n"
    )
    names = json.loads(run(python, code, tmp_path))
    assert names == {kind: packages.list_names(kind) for kind in kinds}


def test_installed_package_resolves_package_urls(python: Path, tmp_path: Path) -> None:
    code = (
        "from pydrake.multibody.parsing import Parser\n"
        "from pydrake.multibody.plant import MultibodyPlant\n"
        "from pips_drake.scene import packages\n"
        "parser = Parser(MultibodyPlant(time_step=0.0))\n"
        "packages.add_package(parser)\n"
        "print(parser.package_map().ResolveUrl('package://pips_drake/arms/prototype.yaml'))\n"
    )
    file = Path(run(python, code, tmp_path).strip())
    assert file.is_relative_to(python.parents[1])
    assert file.read_bytes() == packages.find_arm_file("prototype").read_bytes()
