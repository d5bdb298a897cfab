"""Typed YAML: load a file into a dataclass, refuse what the dataclass does not say.

`pydrake.common.yaml` does the reading. It lets NaN through, takes no frozen dataclasses and does
not run checks of its own (measured), so this module adds: finite numbers, a file name in every
message, and a call of the dataclass's `validate()`.
"""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any, TypeVar

from pips_drake.errors import InputError

T = TypeVar("T")


def load_yaml(schema: type[T], file: Path, *, overrides: dict[str, Any] | None = None) -> T:
    """Reads `file` into the dataclass `schema`, applies `overrides`, checks and returns it.

    Args:
        schema: a dataclass whose fields all have defaults or stand in the file.
        file: the YAML file.
        overrides: dotted field names to values, applied after the file is read.

    Raises:
        InputError: the file is missing, is not YAML, has an unknown key, a wrong type or a number
            that is not finite, or fails the schema's own `validate()`.
    """
    from pydrake.common.yaml import yaml_load_typed

    if not file.is_file():
        raise InputError(f"{file}: no such file")
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file}: not a text file in UTF-8") from None
    try:
        loaded: T = yaml_load_typed(schema=schema, data=text)
    except Exception as error:  # pydrake raises a wide range of types, YAML errors included
        raise InputError(f"{file}: {_first_line(error)}") from None
    for key, value in (overrides or {}).items():
        set_by_dotted_key(loaded, key, value, where=str(file))
    try:
        validate(loaded)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    return loaded


def validate(config: Any) -> None:
    """Checks that every number in a dataclass tree is finite, then calls its `validate()`s."""
    _check_finite(config, where="")
    _call_validate(config)


def dump_yaml(config: Any) -> str:
    """The YAML text that `load_yaml` reads back into an equal dataclass."""
    from pydrake.common.yaml import yaml_dump_typed

    text: str = yaml_dump_typed(config)
    return text


def set_by_dotted_key(config: Any, key: str, value: str, *, where: str) -> None:
    """Sets ``a.b.c`` in a dataclass tree from the text of a command line.

    Raises:
        InputError: no such field, or the text is not of the field's type.
    """
    *parents, leaf = key.split(".")
    target = config
    for depth, part in enumerate(parents):
        target = _field(target, part, where=f"{where}: --set {'.'.join(parents[: depth + 1])}")
    current = _field(target, leaf, where=f"{where}: --set {key}")
    setattr(target, leaf, _parse_like(current, value, where=f"{where}: --set {key}"))


def _field(target: Any, name: str, *, where: str) -> Any:
    if isinstance(target, dict):
        names = list(target)
    elif dataclasses.is_dataclass(target):
        names = [field.name for field in dataclasses.fields(target)]
    else:
        raise InputError(f"{where}: the field before '{name}' has no fields of its own")
    if name not in names:
        raise InputError(f"{where}: unknown key '{name}'; known: {', '.join(sorted(names))}")
    return target[name] if isinstance(target, dict) else getattr(target, name)


def _parse_like(current: Any, text: str, *, where: str) -> Any:
    """The text as a value of the type that the field holds now."""
    if isinstance(current, bool):
        words = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
        if text.lower() not in words:
            raise InputError(f"{where}: '{text}' is not true or false")
        return words[text.lower()]
    if isinstance(current, int | float):
        try:
            return type(current)(text)
        except ValueError:
            raise InputError(f"{where}: '{text}' is not a number") from None
    if isinstance(current, str):
        return text
    if isinstance(current, list) and all(isinstance(item, float) for item in current):
        try:
            return [float(part) for part in re.split(r"[,\s]+", text.strip("[] "))]
        except ValueError:
            raise InputError(f"{where}: '{text}' is not a list of numbers") from None
    raise InputError(f"{where}: this field cannot be set from the command line")


def _check_finite(value: Any, *, where: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{where} = {value}; must be a finite number")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            name = f"{where}.{field.name}" if where else field.name
            _check_finite(getattr(value, field.name), where=name)
    elif isinstance(value, dict):
        for key, item in value.items():
            _check_finite(item, where=f"{where}.{key}" if where else str(key))
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            _check_finite(item, where=f"{where}[{index}]")


def _call_validate(value: Any) -> None:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        for field in dataclasses.fields(value):
            _call_validate(getattr(value, field.name))
        if hasattr(value, "validate"):
            value.validate()
    elif isinstance(value, dict):
        for item in value.values():
            _call_validate(item)
    elif isinstance(value, list | tuple):
        for item in value:
            _call_validate(item)


def _first_line(error: Exception) -> str:
    """The exception's message on one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return " ".join(lines) or type(error).__name__
