"""Typed YAML: what fits is loaded as written, what does not is refused with its full path."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from pips_drake.config import dump_yaml, load_yaml, set_by_dotted_key, validate
from pips_drake.errors import InputError


@dataclass
class Wheel:
    radius_m: float = 0.1
    spokes: int = 8

    def validate(self) -> None:
        if not self.radius_m > 0.0:
            raise InputError(f"radius_m = {self.radius_m}; must be > 0")


@dataclass
class Cart:
    name: str = "cart"
    loaded: bool = False
    mass_kg: float = 1.0
    note: str | None = None
    spare: Wheel | None = None
    front: Wheel = field(default_factory=Wheel)
    wheels: list[Wheel] = field(default_factory=list)
    size_m: list[float] = field(default_factory=lambda: [1.0, 2.0])
    by_name: dict[str, Wheel] = field(default_factory=dict)
    grid: list[list[float]] = field(default_factory=list)


def load(tmp_path: Path, text: str, **overrides: str) -> Cart:
    file = tmp_path / "cart.yaml"
    file.write_text(text)
    return load_yaml(Cart, file, overrides=overrides)


FULL = """\
name: wagon
loaded: true
mass_kg: 4.0e2
note: oak
spare: {radius_m: 0.3}
front: {spokes: 12}
wheels: [{radius_m: 1}, {spokes: 6}]
size_m: [3, 4.5]
by_name: {left: {radius_m: 0.5}}
grid: [[1, 2], []]
"""


def test_a_file_is_read_into_its_dataclass_with_integers_as_numbers(tmp_path):
    cart = load(tmp_path, FULL)
    assert cart == Cart(
        name="wagon",
        loaded=True,
        mass_kg=400.0,  # YAML 1.1 takes 4.0e2 for text
        note="oak",
        spare=Wheel(radius_m=0.3),
        front=Wheel(spokes=12),
        wheels=[Wheel(radius_m=1.0), Wheel(spokes=6)],
        size_m=[3.0, 4.5],
        by_name={"left": Wheel(radius_m=0.5)},
        grid=[[1.0, 2.0], []],
    )
    assert isinstance(cart.mass_kg, float)
    assert isinstance(cart.wheels[0].radius_m, float)


def test_what_the_file_leaves_out_keeps_its_default(tmp_path):
    assert load(tmp_path, "{}") == Cart()
    assert load(tmp_path, "note: null\nspare: null\n") == Cart()


@pytest.mark.parametrize("text", ["{}", FULL], ids=["defaults", "everything"])
def test_what_is_dumped_is_loaded_back_equal(tmp_path, text):
    cart = load(tmp_path, text)
    cart.mass_kg = 0.1 + 0.2  # needs all 17 digits
    cart.name = "no: 12"  # needs quotes
    again = load(tmp_path, dump_yaml(cart))
    assert again == cart
    assert dump_yaml(again) == dump_yaml(cart)


REFUSED = {
    "unknown key": ("colour: red", "unknown key 'colour'; known: by_name, front, grid,"),
    "misspelt key": ("mas_kg: 1", "unknown key 'mas_kg' (did you mean 'mass_kg'?)"),
    "unknown key inside": ("front: {radius: 1}", "front: unknown key 'radius'"),
    "unknown key in a list": (
        "wheels: [{}, {r: 1}]",
        "wheels[1]: unknown key 'r'; known: radius_m",
    ),
    "unknown key in a dict": ("by_name: {a: {r: 1}}", "by_name.a: unknown key 'r'"),
    "unknown key in an optional": ("spare: {r: 1}", "spare: unknown key 'r'"),
    "a key that is no name": ("1: 2", "unknown key '1'"),
    "text for a number": ("mass_kg: heavy", "mass_kg = 'heavy'; must be a number"),
    "flag for a number": ("mass_kg: true", "mass_kg = True; must be a number"),
    "nothing for a number": ("mass_kg:", "mass_kg = null; must be a number"),
    "list for a number": ("mass_kg: [1]", "mass_kg = [1]; must be a number"),
    "nothing inside": ("front: {radius_m: }", "front.radius_m = null; must be a number"),
    "fraction for an integer": (
        "front: {spokes: 1.5}",
        "front.spokes = 1.5; must be a whole number",
    ),
    "number for text": ("name: 12", "name = 12; must be text"),
    "word for a flag": ("loaded: maybe", "loaded = 'maybe'; must be true or false"),
    "number for a flag": ("loaded: 1", "loaded = 1; must be true or false"),
    "nothing for a part": ("front:", "front = null; must be a mapping"),
    "number for a part": ("front: 3", "front = 3; must be a mapping"),
    "list for a part": ("front: [1]", "front = [1]; must be a mapping"),
    "part for a list": ("wheels: {a: 1}", "wheels = {'a': 1}; must be a list"),
    "nothing for a list": ("size_m:", "size_m = null; must be a list"),
    "text for a list": ("size_m: abc", "size_m = 'abc'; must be a list"),
    "text in a list": ("size_m: [1, two]", "size_m[1] = 'two'; must be a number"),
    "text deep in lists": ("grid: [[1], [2, x]]", "grid[1][1] = 'x'; must be a number"),
    "list for a dict": ("by_name: [1]", "by_name = [1]; must be a mapping"),
    "number in a dict": ("by_name: {a: 1}", "by_name.a = 1; must be a mapping"),
    "number as a name": ("by_name: {1: {}}", "by_name = 1; must be a mapping with names"),
    "NaN": ("mass_kg: .nan", "mass_kg = nan; must be a finite number"),
    "NaN as a word": ("front: {radius_m: nan}", "front.radius_m = nan; must be a finite number"),
    "infinity in a list": ("size_m: [.inf]", "size_m[0] = inf; must be a finite number"),
    "too large": ("mass_kg: 1" + "0" * 400, "mass_kg = 1000000000"),
    "failed check": ("front: {radius_m: 0}", "front: radius_m = 0.0; must be > 0"),
    "failed check in a list": ("wheels: [{}, {radius_m: -1}]", "wheels[1]: radius_m = -1.0"),
    "failed check in a dict": ("by_name: {a: {radius_m: 0}}", "by_name.a: radius_m = 0.0"),
    "repeated key": ("name: a\nmass_kg: 1\nname: b", "line 3: key 'name' repeats line 1's"),
    "repeated key inside": (
        "front: {spokes: 1, spokes: 2}",
        "line 1: key 'spokes' repeats line 1's",
    ),
    "repeated key in a list": ("wheels:\n- spokes: 1\n  spokes: 2", "line 3: key 'spokes'"),
    "broken": ("name: a\nsize_m: [1, 2\nfront: {}", "line 3: not YAML: "),
    "tab": ("name: a\n\tmass_kg: 1", "line 2: not YAML: "),
    "unknown alias": ("name: *other", "line 1: not YAML: "),
    "control character": ("name: \x07", "not YAML: "),
    "empty": ("", "empty; must be a mapping"),
    "comment alone": ("# nothing", "empty; must be a mapping"),
    "a list": ("- 1", "the file = [1]; must be a mapping"),
    "a word": ("hello", "the file = 'hello'; must be a mapping"),
    "an object": ("!!python/object/apply:os.getcwd []", ""),
    "a bad date": ("name: 2026-99-99", ""),
    "deep nesting": ("[" * 20000, "not usable YAML: nested too deeply"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_is_refused_in_one_line_with_its_path(tmp_path, case):
    text, words = REFUSED[case]
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'cart.yaml'}: {words}")
    assert "\n" not in message
    assert len(message) < len(str(tmp_path)) + 250


def test_aliases_and_merges_are_no_repeated_keys(tmp_path):
    text = (
        "_small: &small {radius_m: 0.2, spokes: 4}\nfront: {<<: *small, spokes: 5}\nspare: *small\n"
    )
    cart = load(tmp_path, text)
    assert cart.front == Wheel(radius_m=0.2, spokes=5)
    assert cart.spare == Wheel(radius_m=0.2, spokes=4)


def test_a_missing_file_a_folder_and_a_binary_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_yaml(Cart, tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder"):
        load_yaml(Cart, tmp_path)
    file = tmp_path / "binary.yaml"
    file.write_bytes(b"\xff\x00\xfe")
    with pytest.raises(InputError, match="not a text file"):
        load_yaml(Cart, file)


def test_overrides_take_the_type_of_their_field(tmp_path):
    file = tmp_path / "cart.yaml"
    file.write_text(FULL)
    overrides = {
        "name": "12",
        "loaded": "no",
        "mass_kg": "1e3",
        "front.spokes": "3",
        "by_name.left.radius_m": "2",
        "size_m": "[1, 2.5]",
    }
    cart = load_yaml(Cart, file, overrides=overrides)
    assert (cart.name, cart.loaded, cart.mass_kg) == ("12", False, 1000.0)
    assert (cart.front.spokes, cart.by_name["left"].radius_m) == (3, 2.0)
    assert cart.size_m == [1.0, 2.5]


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("front.radius", "1", "--set front.radius: unknown key 'radius'; known: radius_m, spokes"),
        ("back.radius_m", "1", "--set back: unknown key 'back'; known: by_name, front"),
        ("by_name.right.spokes", "1", "unknown key 'right'; known: left"),
        ("mass_kg", "heavy", "--set mass_kg: 'heavy' is not a number"),
        ("front.spokes", "1.5", "'1.5' is not a whole number"),
        ("loaded", "perhaps", "'perhaps' is not true or false"),
        ("size_m", "1, two", "'1, two' is not a list of numbers"),
        ("mass_kg.unit", "1", "has no fields"),
        ("front", "1", "cannot be set"),
        ("front.radius_m", "-1", "front: radius_m = -1.0; must be > 0"),
        ("mass_kg", "nan", "mass_kg = nan; must be a finite number"),
    ],
)
def test_a_bad_override_is_refused_with_its_key(tmp_path, key, text, words):
    file = tmp_path / "cart.yaml"
    file.write_text(FULL)
    with pytest.raises(InputError) as caught:
        load_yaml(Cart, file, overrides={key: text})
    assert str(caught.value).startswith(f"{file}: ")
    assert words in str(caught.value)


def test_an_override_changes_one_field_alone():
    cart = Cart()
    set_by_dotted_key(cart, "front.spokes", "5", where="test")
    assert cart == dataclasses.replace(Cart(), front=Wheel(spokes=5))


def test_validate_reaches_every_part():
    cart = Cart(by_name={"a": Wheel(radius_m=-1.0)})
    with pytest.raises(InputError, match=r"by_name\.a: radius_m = -1\.0"):
        validate(cart)
