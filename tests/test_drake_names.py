"""Every Drake name that we rely on is listed in drake_names.txt, and is in the Drake at hand.

After an upgrade of Drake this says what broke, in one place. After a change of ours that uses
another name:

    python tests/test_drake_names.py

adds what is missing to the list and drops what is no longer used. Whose a method is cannot be read
from the code: where several classes have one of that name, all are added; delete those not meant.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
LIST = Path(__file__).resolve().parent / "drake_names.txt"
HINT = "run `python tests/test_drake_names.py`, look at what it changed, and commit it"
HEAD = """\
# Names of Drake that pips_drake, diagrams and docs rely on: what is imported, and
# members of classes. Sorted; `python tests/test_drake_names.py` adds and drops lines. Its test says
# which of them a new Drake lacks.
"""
#: Members of what else our code handles: such a name on its own says nothing of Drake.
ELSEWHERE = {
    name
    for kind in (np, np.ndarray, str, dict, list, set, tuple, ast, Path, re, Axes, Figure)
    for name in dir(kind)
}
#: How Drake's documentation of a deprecated name or overload begins, after its signature.
DEPRECATED = re.compile(r"(\A|\A[^\n]*\n\n)\(Deprecated")


class Usage:
    """What the source code says of Drake.

    Attributes:
        imported: dotted names that are imported, with what is taken from classes among them.
        attributes: names after a dot in files that use Drake, and the files.
        keywords: (called name, keyword) and where; the called name is dotted if it is imported, and
            begins with a dot if it is a method.
    """

    def __init__(self) -> None:
        self.imported: set[str] = set()
        self.attributes: dict[str, set[str]] = defaultdict(set)
        self.keywords: dict[tuple[str, str], str] = {}
        self.ours: set[str] = set()
        for folder in ("pips_drake", "diagrams", "docs"):
            for file in sorted((ROOT / folder).rglob("*.py")):
                self._read(file)

    def _read(self, file: Path) -> None:
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        alias = {}
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and _is_drake(node.module):
                alias |= {
                    item.asname or item.name: f"{node.module}.{item.name}" for item in node.names
                }
            elif isinstance(node, ast.Import):
                taken = [item for item in node.names if _is_drake(item.name)]
                assert not taken, f"{file}: import names from {taken[0].name} instead"
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                self.ours.add(node.name)
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                self.ours.add(node.target.id)
            elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
                self.ours.add(node.attr)
        self.imported |= set(alias.values())
        for node in nodes:
            if isinstance(node, ast.Attribute):
                # Files that import nothing of Drake get its objects, too.
                self.attributes[node.attr].add(file.name)
                if isinstance(node.value, ast.Name) and node.value.id in alias:
                    self.imported.add(f"{alias[node.value.id]}.{node.attr}")
            if isinstance(node, ast.Call):
                called = ""
                if isinstance(node.func, ast.Name):
                    called = alias.get(node.func.id, "")
                elif isinstance(node.func, ast.Attribute):
                    called = f".{node.func.attr}"
                for keyword in node.keywords:
                    if called and keyword.arg:
                        where = f"{file.relative_to(ROOT)}:{node.lineno}"
                        self.keywords[called, keyword.arg] = where


def _is_drake(module: str | None) -> bool:
    return module is not None and module.split(".")[0] == "pydrake"


def look_up(name: str) -> object:
    """The object of a dotted name.

    Raises:
        AttributeError, ImportError: there is none.
    """
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        module = ".".join(parts[:count])
        try:
            found: object = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not module.startswith(error.name):
                raise
            continue
        for part in parts[count:]:
            found = getattr(found, part)
        return found
    raise ImportError(name)


def members(usage: Usage) -> dict[str, set[str]]:
    """Members of the classes of all modules that are imported from, and whose they are, dotted."""
    modules = sorted({name.rpartition(".")[0] for name in usage.imported})
    public: dict[type, str] = {}
    for module in modules:
        try:
            inside = vars(look_up(module))
        except (AttributeError, ImportError):  # another test says so
            continue
        for name, value in inside.items():
            ours = inspect.isclass(value) and value.__module__.startswith("pydrake")
            # Not the instances of templates: their names have underscores, or letters of their own.
            if ours and name.isascii() and "_" not in name:
                public.setdefault(value, f"{module}.{name}")
    found: dict[str, set[str]] = defaultdict(set)
    for kind, name in public.items():
        for owner in inspect.getmro(kind):
            if owner in (object, Exception) or not owner.__module__.startswith("pydrake"):
                continue
            for member in vars(owner):
                if not member.startswith("_"):
                    found[member].add(public.get(owner, name))
    return found


def listed() -> list[str]:
    lines = LIST.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def missing_from_list(usage: Usage, names: set[str]) -> Iterator[tuple[str, set[str]]]:
    """Names that are used and not listed, with what would list them."""
    for name in sorted(usage.imported - names):
        yield name, {name}
    known = {name.rpartition(".")[2] for name in names}
    for attribute, owners in sorted(members(usage).items()):
        if attribute in usage.attributes and attribute not in known:
            # CamelCase is Drake's; ours would be of the same name by mistake alone.
            drakes_own = attribute[0].isupper() and attribute not in usage.ours
            if drakes_own or attribute not in usage.ours | ELSEWHERE:
                files = ", ".join(sorted(usage.attributes[attribute]))
                yield f".{attribute} ({files})", {f"{owner}.{attribute}" for owner in owners}


def unused(usage: Usage, names: set[str]) -> set[str]:
    """Listed names that nothing uses."""
    return {
        name
        for name in names - usage.imported
        if name.rpartition(".")[2] not in usage.attributes
        or not name.rpartition(".")[0].rpartition(".")[2][0].isupper()
    }


def write_list(usage: Usage) -> None:
    """Brings the list up to date."""
    names = set(listed()) if LIST.exists() else set()
    added = set().union(*(lines for _, lines in missing_from_list(usage, names)))
    dropped = unused(usage, names)
    text = "".join(f"{name}\n" for name in sorted((names | added) - dropped))
    LIST.write_text(HEAD + "\n" + text, encoding="utf-8")
    for sign, changed in (("+", added), ("-", dropped)):
        for name in sorted(changed):
            print(sign, name)


@pytest.fixture(scope="module")
def usage() -> Usage:
    return Usage()


def overloads(function: object) -> list[str]:
    """Documentation of a function's overloads, one text each, signature first."""
    text = inspect.getdoc(function) or ""
    _, several, rest = text.partition("Overloaded function.")
    return re.split(r"\n(?=\d+\. `*\w+\()", rest)[1:] if several else [text]


def takes(name: str, keyword: str) -> str:
    """Why a class or function does not take a keyword argument; empty if it does."""
    function: object = look_up(name)
    if inspect.isclass(function):
        if hasattr(function, keyword):  # configurations take their fields
            return ""
        function = function.__init__
    if inspect.isfunction(function):
        parameters = inspect.signature(function).parameters
        return "" if keyword in parameters else f"{name} has no argument '{keyword}'"
    texts = [text for text in overloads(function) if re.search(rf"\b{keyword}: ", text)]
    if not texts:
        return f"{name} has no argument '{keyword}'"
    if all(DEPRECATED.search(text) for text in texts):
        return f"{name} with '{keyword}' is deprecated"
    return ""


def test_every_listed_name_is_in_this_drake():
    from pips_drake.twin.summary import versions

    gone = []
    for name in listed():
        try:
            look_up(name)
        except (AttributeError, ImportError):
            gone.append(name)
    assert not gone, f"Drake {versions()['drake']} lacks: {', '.join(gone)}"


def test_every_name_that_is_used_is_listed(usage):
    missing = [name for name, _ in missing_from_list(usage, set(listed()))]
    assert not missing, f"not in {LIST.name}: {'; '.join(missing)}; {HINT}"


def test_every_listed_name_is_used(usage):
    names = listed()
    assert names == sorted(set(names)), f"{LIST.name} is not sorted; {HINT}"
    left = sorted(unused(usage, set(names)))
    assert not left, f"nothing uses: {', '.join(left)}; {HINT}"


def test_no_listed_name_is_deprecated():
    marked, looked_at = [], 0
    for name in listed():
        value = look_up(name)
        for described in [value, value.__init__] if inspect.isclass(value) else [value]:
            texts = overloads(described)
            assert texts, name
            looked_at += len(texts)
            if all(DEPRECATED.search(text) for text in texts):
                marked.append(name)
    assert looked_at > len(listed()), "Drake's documentation is no longer read as it is written"
    assert not marked, f"deprecated: {', '.join(marked)}"


def test_every_keyword_argument_is_known_and_not_deprecated(usage):
    by_method = defaultdict(list)
    for name in listed():
        by_method["." + name.rpartition(".")[2]].append(name)
    wrong, looked_at = [], 0
    for (called, keyword), where in sorted(usage.keywords.items()):
        method = called.startswith(".")
        candidates = by_method.get(called, []) if method else [called]
        if not candidates or (method and called[1:] in usage.ours | ELSEWHERE):
            continue
        looked_at += 1
        reasons = [takes(name, keyword) for name in candidates]
        if all(reasons):
            wrong.append(f"{where}: {reasons[0]}")
    assert looked_at > 50
    assert not wrong, "; ".join(wrong)


def test_what_is_missing_gone_or_unused_is_named(usage):
    # Complete here, whatever is missing from the list as it stands.
    names = set(listed()).union(*(lines for _, lines in missing_from_list(usage, set(listed()))))
    name = "pydrake.multibody.plant.MultibodyPlant.SetPositions"
    ((found, lines),) = missing_from_list(usage, names - {name})
    assert found.startswith(".SetPositions (")
    assert name in lines
    name = "pydrake.geometry.SceneGraph"
    assert dict(missing_from_list(usage, names - {name})) == {name: {name}}
    extra = {
        "pydrake.multibody.plant.MultibodyPlant.CalcCenterOfMassPositionInWorld",
        "pydrake.multibody.plant.PropellerInfo",
    }
    assert unused(usage, names | extra) - unused(usage, names) == extra
    for gone in ("pydrake.geometry.NoSuchName", "pydrake.no_such_module.Name"):
        with pytest.raises((AttributeError, ImportError)):
            look_up(gone)


def test_deprecation_is_read_where_drake_writes_it():
    # Both of Drake's styles, by pybind11 and by nanobind; a deprecated value in an enumeration's
    # text says nothing of the others.
    for signature in ("Old(self: Plant, x: float) -> None", "1. ``Old(self, x: float) -> None``"):
        assert DEPRECATED.search(f"{signature}\n\n(Deprecated.)\n\nDeprecated:\n    Use New()")
        assert not DEPRECATED.search(f"{signature}\n\nWhat it does.\n\n(Deprecated values: none)")
    assert DEPRECATED.search("(Deprecated.)\n\nDeprecated:\n    Use New instead.")


def test_an_unknown_keyword_is_told():
    name = "pydrake.systems.primitives.ZeroOrderHold"
    assert takes(name, "period_sec") == ""
    assert takes(name, "period_s") == f"{name} has no argument 'period_s'"
    name = "pydrake.multibody.plant.MultibodyPlantConfig"
    assert takes(name, "time_step") == ""
    assert "no argument" in takes(name, "timestep")


if __name__ == "__main__":
    write_list(Usage())
    sys.exit(0)
