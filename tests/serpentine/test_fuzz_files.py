"""Damaged paths, arms and scenarios: each is usable, or refused with one line; nothing else.

Shipped files are damaged at random (seeded: the same cases in every run) the way that editors,
spreadsheets, disks and strangers damage files. Whatever comes out is read as `pips` reads it. What
loads must also be good for the next step: an SDF, a plan. Warnings are errors here.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.scenarios import load_scenario
from pips_drake.scene.packages import find_arm_file, find_path_file, find_scenario_file
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.tip_path import TipPath

pytestmark = pytest.mark.timeout(280)

#: A reader that computes longer than this (s) hangs for all that a person knows; most need 20 ms.
PATIENCE = 20.0
LONGEST_MESSAGE = 600

#: What numbers turn into.
NASTY = (
    *("nan", ".nan", ".inf", "-.inf", "inf", "1e999", "-1e999", "1e308", "-1e308", "1e-320", "0"),
    *("-0.0", "-1", "1e12", "1e13", "99999999999999999999", "1_000", "0x10", "1:30", "1e5", "null"),
    *("true", "''", '"1"', "~", "1.5.2", "1,5", "٣", "½", "1e", "--1", "!!float 1", "2026-01-01"),
)
#: What gets in between.
STRAY = (
    *(
        b"\0",
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"\xc3\x28",
        b"\r\n",
        b"\r",
        b"\t",
        b"\x1b[31m",
        b"\x85",
    ),
    *(
        "\u2028".encode(),
        b'"',
        b"'",
        b",",
        b";",
        b"#",
        b"---\n",
        b"...\n",
        b"- ",
        b"? ",
        b": ",
        b"{",
    ),
    *(
        b"}",
        b"[",
        b"]",
        b"&a ",
        b"*a ",
        b"<<: *a\n",
        b"!!binary ",
        b"!!set ",
        b"%YAML 9.9\n",
        b"|\n",
    ),
    *(b"unknown_key: 1\n", b"_template: 1\n", b"!!python/name:os.system ", b"=", b">", b"@", b"`"),
)


def damaged(content: bytes, chance: random.Random) -> bytes:
    """The content after one to three accidents."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        content = chance.choice(ACCIDENTS)(content, chance)
    return content


def flip_bits(content: bytes, chance: random.Random) -> bytes:
    data = bytearray(content)
    for _ in range(min(len(data), chance.choice((1, 1, 4, 30)))):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(data)


def cut_out(content: bytes, chance: random.Random) -> bytes:
    first = chance.randrange(len(content) + 1)
    return content[:first] + content[first + chance.choice((1, 1, 5, 40, 10**6)) :]


def insert(content: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(content) + 1)
    return content[:at] + chance.choice(STRAY) * chance.choice((1, 1, 1, 3, 200)) + content[at:]


def change_number(content: bytes, chance: random.Random) -> bytes:
    text = content.decode(errors="surrogateescape")
    digits = [i for i, letter in enumerate(text) if letter.isdigit()]
    if not digits:
        return content
    first = last = chance.choice(digits)
    while first and text[first - 1] in "0123456789.-+e":
        first -= 1
    while last < len(text) and text[last] in "0123456789.-+e":
        last += 1
    text = text[:first] + chance.choice(NASTY) + text[last:]
    return text.encode(errors="surrogateescape")


def change_lines(content: bytes, chance: random.Random) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
    what = chance.randrange(5)
    if what == 0:
        lines.insert(j, lines[i])
    elif what == 1:
        del lines[i]
    elif what == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif what == 3:
        lines[i] = b"  " + lines[i]
    else:
        lines[i] *= 100
    return b"".join(lines)


def encode_otherwise(content: bytes, chance: random.Random) -> bytes:
    text = content.decode(errors="replace")
    return text.encode(chance.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7")))


def end_lines_otherwise(content: bytes, chance: random.Random) -> bytes:
    return content.replace(b"\n", chance.choice((b"\r\n", b"\r", b"\n\n", b"\x0b", b"\x0c", b"")))


def nest(content: bytes, chance: random.Random) -> bytes:
    depth = chance.choice((3, 49, 60, 1000, 20000))
    opening, closing = chance.choice(((b"[", b"]"), (b"{a: ", b"}"), (b"- ", b""), (b"? ", b"")))
    at = content.find(b":", chance.randrange(len(content) + 1)) + 1
    return content[:at] + b" " + opening * depth + b"1" + closing * depth + b"\n" + content[at:]


def alias(content: bytes, chance: random.Random) -> bytes:
    lines = [b"bomb0: &bomb0 " + chance.choice((b"[1]", b"{mass_kg: 1}", b"1"))]
    opening, closing = chance.choice(((b"[", b"]"), (b"{<<: [", b"]}"), (b"{? ", b": 1}")))
    width = chance.choice((1, 2, 10))
    for i in range(1, chance.choice((2, 10, 30))):
        names = b",".join([b"*bomb%d" % (i - 1)] * width)
        lines.append(b"bomb%d: &bomb%d " % (i, i) + opening + names + closing)
    return b"\n".join([*lines, content])


def lengthen(content: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(content) + 1)
    return content[:at] + chance.choice((b"x", b"1", b" ", b"1,", b"#")) * 30_000 + content[at:]


Accident = Callable[[bytes, random.Random], bytes]
#: Numbers and lines more often: those get past the first reader.
ACCIDENTS: tuple[Accident, ...] = (
    *(change_number,) * 6,
    *(change_lines,) * 3,
    *(flip_bits, cut_out, insert) * 2,
    *(encode_otherwise, end_lines_otherwise, nest, alias, lengthen),
)


def use_path(path: TipPath) -> None:
    if path.travel < 5.0:  # m; longer plans take seconds
        make_plan(load_arm("prototype"), path)


def read_path(file: Path) -> None:
    use_path(load_path(file))


def read_smooth_path(file: Path) -> None:
    use_path(load_path(file, smooth=True, corner_deviation=0.006))


def read_arm(file: Path) -> None:
    make_sdf(load_arm(file))


def read_scenario(file: Path) -> None:
    loaded = load_scenario(str(file))
    load_setup(loaded.config, folder=loaded.folder)


#: Shipped files, who reads them, and how many cases: PyYAML needs 70 ms for an arm.
FILES: dict[str, tuple[Path, Callable[[Path], None], int]] = {
    "a table": (find_path_file("trajectory_4"), read_path, 800),
    "a blended table": (find_path_file("trajectory_1"), read_smooth_path, 800),
    "lines and arcs": (find_path_file("trajectory_4_arcs"), read_path, 400),
    "an arm": (find_arm_file("prototype"), read_arm, 150),
    "another arm": (find_arm_file("pcr_concept"), read_arm, 150),
    "a scenario": (find_scenario_file("trajectory_1"), read_scenario, 300),
}


def fuzz(kind: str, folder: Path, cases: int, seed: int) -> Counter[str]:
    """Reads damaged files; returns how many were usable and how many refused."""
    file, read, _ = FILES[kind]
    content, chance, counts = file.read_bytes(), random.Random(f"{kind} {seed}"), Counter()
    read(file)  # compiles what it needs
    for case in range(cases):
        copy = folder / f"damaged{file.suffix}"
        copy.write_bytes(damaged(content, chance))
        begin = time.process_time()
        try:
            read(copy)
            counts["usable"] += 1
        except (InputError, NotFollowableError) as error:
            message = str(error)
            assert 0 < len(message) <= LONGEST_MESSAGE, f"case {case}"
            counts["refused"] += 1
        except BaseException as error:
            raise AssertionError(f"case {case} of {kind}: {error!r}") from error
        assert time.process_time() - begin < PATIENCE, f"case {case} of {kind}"
    assert {entry.name for entry in folder.iterdir()} == {copy.name}
    return counts


@pytest.mark.parametrize("kind", FILES)
def test_a_damaged_file_is_usable_or_refused(tmp_path, kind):
    counts = fuzz(kind, tmp_path, max(40, FILES[kind][2] // 10), seed=1)
    # The cases must reach both ends, or they would show little.
    assert counts["refused"] >= 5 and counts["usable"] >= 2


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_so_are_thousands(tmp_path, kind):
    cases = FILES[kind][2]
    counts = fuzz(kind, tmp_path, cases, seed=2)
    assert counts["refused"] >= 0.3 * cases and counts["usable"] >= 0.1 * cases
