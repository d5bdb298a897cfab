"""The summary sheet says the verdict, every row and every failure, in both forms."""

import base64
import re

import matplotlib.image
import numpy as np
import pytest

from pips_drake.twin.sheet import Sheet, SheetPicture, SheetRow, write_sheet

GREEN, RED = (0x1B, 0x7F, 0x4B), (0xB2, 0x22, 0x22)


@pytest.fixture(name="sheet")
def _sheet(tmp_path):
    picture = tmp_path / "picture.png"
    matplotlib.image.imsave(picture, np.full((40, 60, 3), (0.2, 0.4, 0.9)))
    return Sheet(
        title="a < b & c",
        passed=False,
        lead="half a run",
        failures=("the arm penetrates the payload: -3.0 mm",),
        rows=(
            SheetRow(label="clearance", value="-3 mm", allowed=">= 25 mm", good=False),
            SheetRow(label="force", value="40 %", allowed="<= 100 %", good=True),
            SheetRow(label="deviation", value="33 mm"),
        ),
        pictures=(SheetPicture(file=picture, caption="the tightest moment"),),
    )


def _share(picture, colour):
    """Share of a picture's pixels of a colour."""
    return np.mean(np.all(np.abs(picture - np.array(colour) / 255.0) < 0.02, axis=-1))


def test_the_page_holds_everything_and_escapes_it(sheet, tmp_path):
    write_sheet(tmp_path, sheet)
    page = (tmp_path / "summary.html").read_text(encoding="utf-8")
    assert "a &lt; b &amp; c" in page
    assert "a < b" not in page
    for text in ("FAIL", "half a run", "-3.0 mm", "&gt;= 25 mm", "deviation"):
        assert text in page
    # The picture is inside the page, so that the page can be sent alone.
    (encoded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert base64.b64decode(encoded) == sheet.pictures[0].file.read_bytes()
    assert "http" not in page


def test_the_picture_of_the_sheet_shows_the_verdicts_colour(sheet, tmp_path):
    for passed, colour, other in ((False, RED, GREEN), (True, GREEN, RED)):
        rows = tuple(SheetRow(label="x", value="1") for _ in sheet.rows)
        plain = Sheet(
            title="t", passed=passed, lead="", failures=(), rows=rows, pictures=sheet.pictures
        )
        write_sheet(tmp_path, plain)
        picture = matplotlib.image.imread(tmp_path / "summary.png")[:, :, :3]
        assert _share(picture, colour) > 0.002
        assert _share(picture, other) == 0.0


def test_the_same_sheet_gives_the_same_bytes(sheet, tmp_path):
    first, second = tmp_path / "1", tmp_path / "2"
    for folder in (first, second):
        folder.mkdir()
        write_sheet(folder, sheet)
    for name in ("summary.png", "summary.html"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
