"""The words of an autopilot's script, and what is said about wrong ones."""

from typing import Any

import pytest

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.script import WORDS, ScriptStep

WHOLE: dict[str, Any] = {
    "height_m": 0.5,
    "standoff_m": 1.0,
    "to_m": 4.0,
    "seconds": 3.0,
    "by_m": [0.0, 0.0, -1.0],
    "angles_deg": [0.0, 90.0, -90.0, 0.0, -90.0, 0.0],
    "station": "K",
}


@pytest.mark.parametrize("word", WORDS)
def test_a_word_is_taken_with_the_fields_it_needs_and_with_no_other(word: str) -> None:
    needed = WORDS[word][0]
    fields: dict[str, Any] = {name: WHOLE[name] for name in needed}
    if word == "carry":
        fields["by_m"] = WHOLE["by_m"]
    ScriptStep(do=word, **fields).validate()
    for name in needed:
        rest = {key: value for key, value in fields.items() if key != name}
        with pytest.raises(InputError, match=f"step {word}: no {name}"):
            ScriptStep(do=word, **rest).validate()
    foreign = next(name for name in WHOLE if name not in (*needed, *WORDS[word][1]))
    with pytest.raises(InputError, match=f"step {word}: {foreign} given"):
        ScriptStep(do=word, **fields, **{foreign: WHOLE[foreign]}).validate()


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (ScriptStep(do="carry"), "neither by_m nor turn_deg"),
        (ScriptStep(do="carry", by_m=[1.0, 2.0]), "by_m"),
        (ScriptStep(do="move_joints", angles_deg=[0.1] * 5), "angles_deg"),
        (ScriptStep(do="approach", height_m=-1.0), "height_m"),
        (ScriptStep(do="approach", height_m=float("nan")), "height_m"),
        (ScriptStep(do="descend", speed_m_s=2.0), "speed_m_s"),
        (ScriptStep(do="wait", seconds=-1.0), "seconds"),
    ],
)
def test_a_wrong_number_is_named(step: ScriptStep, said: str) -> None:
    with pytest.raises(InputError, match=said):
        step.validate()


@pytest.mark.parametrize("step", [ScriptStep(do="fly"), ScriptStep(do="camera", station="KL")])
def test_an_unknown_word_or_station_is_told_with_the_known_ones(step: ScriptStep) -> None:
    with pytest.raises(UnknownNameError):
        step.validate()
