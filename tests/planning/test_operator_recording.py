"""An operator's session as a file: read, repeated, written, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake.errors import InputError
from pips_drake.planning.controls import same_wish
from pips_drake.planning.operator_recording import read_recording, write_recording
from pips_drake.serpentine.motion_words import HOLD, RUN

SHIPPED = Path(__file__).parents[2] / "diagrams" / "teleoperate.yaml"
HEAD = "arm: cmu_92\nscene: cargo_bay\npath_m: [[0.4, 0.0, 4.4], [0.4, 0.0, 6.0]]\n"


def written(tmp_path, events, head=HEAD):
    file = tmp_path / "session.yaml"
    file.write_text(head + "events:\n" + "".join(f"- {event}\n" for event in events))
    return file


def test_what_an_event_does_not_state_stays(tmp_path):
    events = [
        "{time_s: 0.0, word: run, goal_m: [0.4, 0.0, 5.9], tension_N: 2.0}",
        "{time_s: 2.0, pull_at_m: [0.4, 0.0, 5.0], pull_N: [0.0, 3.0, 0.0]}",
        "{time_s: 3.0, pull_N: [0.0, 0.0, 0.0], nails_m: [[0.4, 0.1, 5.0]]}",
        "{time_s: 4.0, word: hold, nails_m: [], reach_m: 0.5}",
    ]
    recording = read_recording(written(tmp_path, events))
    assert recording.times == (0.0, 2.0, 3.0, 4.0)
    assert (recording.duration, recording.extended) == (5.0, 0.0)
    first = recording.at(1.99)
    assert (first.word, first.tension, first.pulls) == (RUN, 2.0, ())
    place, force = recording.at(2.0).pulls[0]
    assert_allclose([place, force], [[0.4, 0.0, 5.0], [0.0, 3.0, 0.0]], rtol=0, atol=0)
    assert_allclose(recording.at(3.5).nails, [[0.4, 0.1, 5.0]], rtol=0, atol=0)
    assert recording.at(3.5).pulls == ()
    last = recording.at(100.0)
    assert (last.word, last.reach, last.tension, len(last.nails)) == (HOLD, 0.5, 2.0, 0)
    assert_allclose(last.goal, [0.4, 0.0, 5.9], rtol=0, atol=0)


def test_a_written_recording_reads_back_the_same(tmp_path):
    shipped = read_recording(SHIPPED)
    file = tmp_path / "again.yaml"
    file.write_text(write_recording(shipped))
    again = read_recording(file)
    assert again.times == shipped.times
    assert again.duration == shipped.duration and again.extended == shipped.extended
    assert_allclose(again.path, shipped.path, rtol=0, atol=0)
    assert all(map(same_wish, again.wishes, shipped.wishes))
    assert not same_wish(again.wishes[0], again.wishes[-1])
    assert np.unique(shipped.times).size == len(shipped.times) >= 8


@pytest.mark.parametrize(
    ("events", "head", "words"),
    [
        ([], HEAD, "events"),
        (["{time_s: 1.0}"], HEAD, r"events\[0\].time_s = 1\.0; must be 0 in the first event"),
        (["{time_s: 0.0}", "{time_s: 0.0}"], HEAD, r"events\[1\].time_s = 0\.0; must be > 0"),
        (["{time_s: 0.0, word: go}"], HEAD, r"unknown events\[0\].word 'go'.*hold"),
        (["{time_s: 0.0, gaol_m: [0, 0, 0]}"], HEAD, r"unknown key in events\[0\] 'gaol_m'"),
        (["{time_s: 0.0, goal_m: [0, 0]}"], HEAD, r"goal_m = \[\[0, 0\]\]; must be three finite"),
        (["{time_s: 0.0, pull_N: [0, 1, 0]}"], HEAD, "must come with pull_at_m"),
        (["{time_s: 0.0, tension_N: .nan}"], HEAD, r"tension_N = nan; must be a finite number"),
        (["{time_s: 0.0, tension_N: -1.0}"], HEAD, r"events\[0\]: operator's tension = -1\.0 N"),
        (["{time_s: 0.0}"], HEAD + "duration_s: -1.0\n", r"duration_s = -1\.0; must be > 0"),
        (["{time_s: 0.0}"], "arm: 3\n", "arm = 3; must be a name"),
        (["{time_s: 0.0}"], HEAD + "speed: 3\n", "unknown key 'speed'"),
    ],
)
def test_what_means_nothing_is_refused_in_one_line(tmp_path, events, head, words):
    with pytest.raises(InputError, match=words) as caught:
        read_recording(written(tmp_path, events, head))
    assert "\n" not in str(caught.value)
