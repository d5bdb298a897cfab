"""Typed YAML: load a file into a dataclass, refuse what the dataclass does not say.

`pydrake.common.yaml` builds the objects. It takes no frozen dataclasses, lets NaN and repeated keys
through, checks nothing of its own and says "AssertionError" where a list is missing (measured). So
the file is first compared with the schema here: every message names the file, the key's full path,
the value and what is allowed. Then come finite numbers and the dataclass's own `validate()`.
"""

from __future__ import annotations

import dataclasses
import math
import re
import reprlib
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

import yaml

from pips_drake.errors import InputError, UnknownNameError, shorten

T = TypeVar("T")

#: Numbers beyond this are mistakes in any unit of ours, and their squares may overflow.
LARGEST = 1e12
#: Longer YAML files (bytes) are refused: the longest shipped one has 6,000, and PyYAML reads about
#: 100,000 a second.
LARGEST_YAML = 500_000
#: Longer files of any kind (bytes) are refused before they fill the memory.
LARGEST_FILE = 20_000_000
#: YAML's aliases repeat what they stand for: a few lines can stand for billions of values.
MOST_VALUES = 100_000
#: Deeper nesting is none of ours, and readers of YAML call themselves for each level.
DEEPEST = 50


def load_yaml(schema: type[T], file: Path, *, overrides: dict[str, Any] | None = None) -> T:
    """Reads `file` into the dataclass `schema`, applies `overrides`, checks and returns it.

    Args:
        schema: a dataclass whose fields all have defaults (pydrake fills in a default object); a
            field that a file must state has a default that `validate()` refuses.
        file: the YAML file.
        overrides: dotted field names to values, applied after the file is read.

    Raises:
        InputError: the file is missing, is not YAML, has an unknown or repeated key, a wrong type
            or a number that is not finite, or fails the schema's own `validate()`.
    """
    from pydrake.common.yaml import yaml_load_typed

    text = read_text(file, largest=LARGEST_YAML)
    try:
        _check_against(schema, _parse(text), where="")
        loaded: T = yaml_load_typed(schema=schema, data=text)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except Exception as error:  # pydrake raises a wide range of types for what is left
        raise InputError(f"{file}: {_first_line(error)}") from None
    for key, value in (overrides or {}).items():
        set_by_dotted_key(loaded, key, value, where=str(file))
    try:
        validate(loaded)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    return loaded


def load_plain(file: Path) -> dict[str, Any]:
    """The mapping that a YAML file holds, not compared with any schema.

    Raises:
        InputError: the file cannot be read, is not YAML, or holds no mapping.
    """
    text = read_text(file, largest=LARGEST_YAML)
    try:
        data = _parse(text)
        _require_type(isinstance(data, dict), "", data, "a mapping")
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    mapping: dict[str, Any] = data
    return mapping


def read_text(file: Path, *, largest: int = LARGEST_FILE) -> str:
    """The text of a UTF-8 file.

    Args:
        largest: bytes; a longer file is refused.

    Raises:
        InputError: says why the file cannot be read.
    """
    try:
        if not file.is_file():  # devices and pipes are none either: reading them may not end
            what = "is a folder, not a file" if file.is_dir() else "no such file"
            raise InputError(f"{file}: {what}")
        size = file.stat().st_size
        require(size <= largest, f"{file}: size", f"{size} bytes", f"<= {largest}")
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{file}: not a text file in UTF-8") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from None


def validate(config: Any) -> None:
    """Checks that every number in a dataclass tree is finite, then calls its `validate()`s."""
    _check_finite(config, where="")
    _call_validate(config, where="")


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


def require(condition: bool, name: str, value: object, allowed: str) -> None:
    """Raises `InputError` as "name = value; must be allowed" unless the condition holds."""
    if not condition:
        raise InputError(f"{name} = {shorten(str(value))}; must be {allowed}")


def require_positive(config: object, *names: str) -> None:
    """Raises `InputError` unless the named fields are positive."""
    for name in names:
        value = getattr(config, name)
        require(value > 0.0, f"{type(config).__name__}.{name}", value, "> 0")


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
            kind = "whole number" if isinstance(current, int) else "number"
            raise InputError(f"{where}: '{text}' is not a {kind}") from None
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
    if isinstance(value, int | float) and abs(value) > LARGEST:
        raise InputError(f"{where} = {value:g}; must be within +-{LARGEST:g}")
    for name, item in _children(value, where):
        _check_finite(item, where=name)


def _call_validate(value: Any, *, where: str) -> None:
    for name, item in _children(value, where):
        _call_validate(item, where=name)
    if (
        dataclasses.is_dataclass(value)
        and not isinstance(value, type)
        and hasattr(value, "validate")
    ):
        try:
            value.validate()
        except InputError as error:
            said = not where or str(error).startswith(f"{where}.")
            raise InputError(str(error) if said else f"{where}: {error}") from None


def _children(value: Any, where: str) -> list[tuple[str, Any]]:
    """Dotted names and values of what a dataclass, mapping or list holds."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value)]
        return [(_join(where, name), getattr(value, name)) for name in names]
    if isinstance(value, dict):
        return [(_join(where, key), item) for key, item in value.items()]
    if isinstance(value, list | tuple):
        return [(f"{where}[{index}]", item) for index, item in enumerate(value)]
    return []


def _join(where: str, key: object) -> str:
    return f"{where}.{key}" if where else str(key)


def _parse(text: str) -> Any:
    """The file's plain data."""
    from pydrake.common.yaml import yaml_load

    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if node is None:
            raise InputError("empty; must be a mapping")
        _refuse_bombs(node)
        _refuse_repeated_keys(node, set())
        data = yaml_load(data=text, private=True)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark else ""
        raise InputError(f"{line}not YAML: {error.problem or error.context}") from None
    except yaml.YAMLError as error:
        raise InputError(f"not YAML: {_first_line(error)}") from None
    except RecursionError:
        raise InputError("not usable YAML: nested too deeply") from None
    except (TypeError, ValueError) as error:  # dates that do not exist, numbers too long to read
        raise InputError(f"not usable YAML: {_first_line(error)}") from None
    if isinstance(data, dict):  # pydrake's convention: root keys such as _template are nobody's
        data = {key: item for key, item in data.items() if not str(key).startswith("_")}
    return data


def _refuse_bombs(root: yaml.Node) -> None:
    """Refuses nesting that is deep or endless, and aliases that stand for too many values."""
    values: dict[int, int] = {}  # by node: how many values it stands for

    def count(node: yaml.Node, depth: int) -> int:
        line = node.start_mark.line + 1
        if depth > DEEPEST:
            raise InputError(f"line {line}: nested too deeply; must be at most {DEEPEST} levels")
        if id(node) in values:
            if values[id(node)] == 0:  # still being counted
                raise InputError(f"line {line}: contains itself")
            return values[id(node)]
        values[id(node)] = 0
        total = 1
        if not isinstance(node, yaml.ScalarNode):
            for item in node.value:
                for part in item if isinstance(item, tuple) else (item,):
                    total += count(part, depth + 1)
        if total > MOST_VALUES:
            raise InputError(f"line {line}: stands for over {MOST_VALUES} values")
        values[id(node)] = total
        return total

    count(root, 0)


def _refuse_repeated_keys(node: yaml.Node, seen: set[int]) -> None:
    """YAML forbids a key twice in a mapping; PyYAML lets the last one win."""
    if id(node) in seen:  # an alias: already looked at, and it may contain itself
        return
    seen.add(id(node))
    if isinstance(node, yaml.MappingNode):
        lines: dict[str, int] = {}
        for key, item in node.value:
            line = key.start_mark.line + 1
            if isinstance(key, yaml.ScalarNode):
                if key.value in lines:
                    first = lines[key.value]
                    name = shorten(key.value)
                    raise InputError(f"line {line}: key '{name}' repeats line {first}'s")
                lines[key.value] = line
            _refuse_repeated_keys(item, seen)
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_repeated_keys(item, seen)


def _check_against(schema: Any, value: Any, *, where: str) -> None:
    """Refuses plain data that does not fit a schema: dataclass, list, dict, scalar, X | None.

    Other types, unions with tags and Drake's own structures among them, are left to pydrake.
    """
    origin, arguments = typing.get_origin(schema), typing.get_args(schema)
    if origin in (typing.Union, types.UnionType):
        options = [option for option in arguments if option is not types.NoneType]
        if len(options) == 1 and value is not None:
            _check_against(options[0], value, where=where)
    elif dataclasses.is_dataclass(schema) and isinstance(schema, type):
        _require_type(isinstance(value, dict), where, value, "a mapping")
        hints = typing.get_type_hints(schema)
        for key, item in value.items():
            if key not in hints:
                message = str(UnknownNameError("key", str(key), list(hints)))
                raise InputError(f"{where}: {message}" if where else message)
            _check_against(hints[key], item, where=_join(where, key))
    elif origin is list:
        _require_type(isinstance(value, list), where, value, "a list")
        for index, item in enumerate(value):
            _check_against(arguments[0], item, where=f"{where}[{index}]")
    elif origin is dict:
        _require_type(isinstance(value, dict), where, value, "a mapping")
        for key, item in value.items():
            _require_type(isinstance(key, str), where, key, "a mapping with names as keys")
            _check_against(arguments[1], item, where=_join(where, key))
    elif schema in _SCALARS:
        fits, allowed = _SCALARS[schema]
        _require_type(fits(value), where, value, allowed)


def _is_float(value: Any) -> bool:
    # PyYAML reads 4.0e7 as text, because YAML 1.1 wants 4.0e+7; pydrake turns it into a number.
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return False
    try:
        float(value)
    except (ValueError, OverflowError):
        return False
    return True


def _is_int(value: Any) -> bool:
    if isinstance(value, str):
        return re.fullmatch(r"[-+]?\d+", value) is not None
    return _is_float(value) and float(value).is_integer()


_SCALARS = {
    bool: (lambda value: isinstance(value, bool) or value in ("true", "false"), "true or false"),
    int: (_is_int, "a whole number"),
    float: (_is_float, "a number"),
    str: (lambda value: isinstance(value, str), "text (in quotes if it looks like a number)"),
}


def _require_type(condition: bool, where: str, value: Any, allowed: str) -> None:
    if not condition:
        # reprlib's stops where repr's would not: lists may contain themselves, thousands of times.
        shown = "null" if value is None else reprlib.repr(value)
        raise InputError(f"{where or 'the file'} = {shown}; must be {allowed}")


def _first_line(error: Exception) -> str:
    """The exception's message on one line."""
    return shorten(" ".join(str(error).split()), 400) or type(error).__name__
