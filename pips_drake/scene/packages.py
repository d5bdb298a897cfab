"""Where the shipped models, scenarios and studies are, and which file a name stands for.

In a checkout `models/`, `scenarios/` and `studies/` stand at the top, beside the package; a wheel
carries them inside it. ``package://pips_drake/...`` stands for the folder `models` in both.

A name is first looked up among the shipped files (``trajectory_4``); anything else is the path of a
file. Kinds of file, and where their names come from:

- ``arm``: ``models/arms/NAME.yaml``
- ``manipulator``: ``models/manipulators/NAME.yaml``
- ``cable robot``: ``models/cable_robots/NAME.yaml``
- ``path``: ``models/paths/NAME.csv`` or ``NAME.yaml``
- ``model``: ``models/sdf/*/NAME.sdf``
- ``scene``: ``models/scenes/NAME.dmd.yaml``
- ``scenario``: ``scenarios/NAME.yaml``
- ``study``: ``studies/NAME.yaml``
- ``joint motion``, ``obstacles``, ``operator recording``: none is shipped
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pips_drake.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from pydrake.multibody.parsing import Parser

_PACKAGE = Path(__file__).resolve().parents[1]

# Patterns are relative to the folder that holds models/, scenarios/ and studies/.
_PATTERNS = {
    "arm": ("models/arms/*.yaml",),
    "manipulator": ("models/manipulators/*.yaml",),
    "cable robot": ("models/cable_robots/*.yaml",),
    "path": ("models/paths/*.csv", "models/paths/*.yaml"),
    "model": ("models/sdf/*/*.sdf",),
    "scene": ("models/scenes/*.dmd.yaml",),
    "scenario": ("scenarios/*.yaml",),
    "study": ("studies/*.yaml",),
    "joint motion": (),
    "obstacles": (),
    "operator recording": (),
}


def models_directory() -> Path:
    """The folder with the shipped arms, paths, models and scenes."""
    return _data_root() / "models"


def scenarios_directory() -> Path:
    """The folder with the shipped scenarios."""
    return _data_root() / "scenarios"


def list_names(kind: str) -> list[str]:
    """The sorted names of the shipped files of a kind; the module's docstring has the kinds.

    Raises:
        UnknownNameError: no such kind.
    """
    return sorted(_shipped_files(kind))


def find_file(kind: str, name: str, *, inside: Path | None = None) -> Path:
    """The file that a name, or the path of a file, stands for.

    Args:
        kind: what is looked for; the module's docstring has the kinds.
        name: a shipped name, or the path of a file.
        inside: for a name that stands in a file, that file's folder: a relative path starts there,
            and no path may lead out of it, shipped files excepted. None: a path is taken as it is.

    Raises:
        UnknownNameError: neither a shipped name nor an existing file.
        InputError: the path leads out of `inside`.
    """
    shipped = _shipped_files(kind)
    if name in shipped:
        return shipped[name]
    file = Path(name) if inside is None else inside / name
    if name and _is_folder(file):
        raise InputError(f"{kind} '{name}' is a folder; must be a shipped name or a file")
    if not _is_file(file):
        raise UnknownNameError(kind, name, list(shipped))
    if inside is not None:
        allowed = [inside, models_directory(), scenarios_directory()]
        if not any(file.resolve().is_relative_to(folder.resolve()) for folder in allowed):
            raise InputError(f"{kind} '{name}' lies outside {inside}; must be shipped or inside it")
    return file


def find_arm_file(name: str, *, inside: Path | None = None) -> Path:
    """The arm file of a name such as ``prototype``; see `find_file`."""
    return find_file("arm", name, inside=inside)


def find_path_file(name: str, *, inside: Path | None = None) -> Path:
    """The tip path file of a name such as ``trajectory_4``; see `find_file`."""
    return find_file("path", name, inside=inside)


def find_joint_motion_file(name: str, *, inside: Path | None = None) -> Path:
    """The file of a motion given by joints; see `find_file`."""
    return find_file("joint motion", name, inside=inside)


def find_model_file(name: str, *, inside: Path | None = None) -> Path:
    """The SDF file of a model's name; see `find_file`."""
    return find_file("model", name, inside=inside)


def find_scene_file(name: str, *, inside: Path | None = None) -> Path:
    """The model directives of a scene's name; see `find_file`."""
    return find_file("scene", name, inside=inside)


def find_scenario_file(name: str) -> Path:
    """The scenario file of a name such as ``trajectory_4``; see `find_file`."""
    return find_file("scenario", name)


def find_study_file(name: str) -> Path:
    """The study file of a name such as ``offsets``; see `find_file`."""
    return find_file("study", name)


def add_package(parser: Parser) -> None:
    """Lets the parser resolve ``package://pips_drake/...``; a second call changes nothing."""
    parser.package_map().AddPackageXml(str(models_directory() / "package.xml"))


def add_package_beside(parser: Parser, file: Path) -> None:
    """Lets the parser resolve `package://` of the package that a file's folder is, if it is one.

    Raises:
        RuntimeError: the folder's `package.xml` names none, or one that is somewhere else.
    """
    package = file.absolute().parent / "package.xml"
    if _is_file(package):
        parser.package_map().AddPackageXml(str(package))


def _data_root() -> Path:
    """The folder that holds `models` and `scenarios`: the package in a wheel, else its parent.

    The package is looked at first: beside an installed one stand other people's folders.
    """
    return _PACKAGE if (_PACKAGE / "models" / "package.xml").is_file() else _PACKAGE.parent


def _shipped_files(kind: str) -> dict[str, Path]:
    """The shipped files of a kind by name: the file's name without what the pattern fixes."""
    if kind not in _PATTERNS:
        raise UnknownNameError("kind of file", kind, list(_PATTERNS))
    files = {}
    for pattern in _PATTERNS[kind]:
        suffix = pattern.rpartition("*")[2]
        for file in _data_root().glob(pattern):
            files[file.name.removesuffix(suffix)] = file
    return files


def _is_folder(file: Path) -> bool:
    try:
        return file.is_dir()
    except (OSError, ValueError):
        return False


def _is_file(file: Path) -> bool:
    """Whether it is a file; text that cannot be a path at all (too long, a null byte) is none."""
    try:
        return file.is_file()
    except (OSError, ValueError):
        return False
