"""Writes docs/ports.md: every system's ports, from the docstrings of the classes.

    python docs/make_ports.py

A test compares the file with what this writes, and another the docstrings with the live ports.
"""

import importlib
import inspect
import pkgutil
from pathlib import Path

from pydrake.systems.framework import LeafSystem

import pips_drake

FILE = Path(__file__).resolve().parent / "ports.md"
HEAD = """# Systems and their ports

Written by `python docs/make_ports.py` from the classes' docstrings: edit those. J is the number of
an arm's joints, A that of its actuators, M that of its modules, or of a robot's cables. Every
system works alone in a diagram of your own; how a station connects them is in its machine's
`station/`, and a run's `diagram.svg` draws it.
"""


def systems() -> list[type]:
    """All LeafSystems of the package, by module and name."""
    found = []
    for module in pkgutil.walk_packages(pips_drake.__path__, "pips_drake."):
        parts = module.name.split(".")
        if "systems" not in parts[:-1]:
            continue
        for _, member in inspect.getmembers(importlib.import_module(module.name), inspect.isclass):
            if issubclass(member, LeafSystem) and member.__module__ == module.name:
                found.append(member)
    return sorted(found, key=lambda system: (system.__module__, system.__name__))


def as_markdown(system: type) -> str:
    """A system's section: its docstring without the machine-readable block."""
    text = inspect.cleandoc(system.__doc__ or "")
    lines, skipping, arguments = [], False, False
    for line in text.splitlines():
        if line.startswith(".. pydrake_system::"):
            skipping = True
        elif line and not line.startswith(" "):
            skipping, arguments = False, line == "Args:"
        if skipping:
            continue
        # Indented arguments would be a block of code in Markdown; a list they are.
        if arguments and line.startswith("        "):
            line = "  " + line.strip()
        elif arguments and line.startswith("    "):
            name, colon, rest = line.strip().partition(":")
            line = f"- `{name}`{colon}{rest}"
        lines.append("Arguments:\n" if line == "Args:" else line)
    body = "\n".join(lines).strip()
    while "\n\n\n" in body:
        body = body.replace("\n\n\n", "\n\n")
    return f"## {system.__name__}\n\n`{system.__module__}`\n\n{body}\n"


def make() -> str:
    """The whole page."""
    return HEAD + "\n" + "\n".join(as_markdown(system) for system in systems())


if __name__ == "__main__":
    FILE.write_text(make(), encoding="utf-8")
    print(FILE.name)
