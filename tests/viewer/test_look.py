"""What the panel's choices make of each submap, and what the panel tells of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes import look_at
from tests.viewer.conftest import HOSTILE
from uppm.core.errors import InputError
from uppm.core.shown import Answers, Shown
from uppm.map.panoptic_map import PanopticMap
from uppm.map.shown import asked, content_of, live_content
from uppm.viewer.facts import answers_html, facts_html
from uppm.viewer.flight import near_view, start_view
from uppm.viewer.look import ANSWER_COLOR, BEST_COLOR, DIMMED_OPACITY, Look, style_of
from uppm.viewer.nodes import path_lines


@pytest.fixture(scope="module")
def shown(panoptic: PanopticMap) -> dict[int, Shown]:
    return {s.submap.id: s for s in content_of(panoptic, "room").shown}


def test_answers_are_coloured_and_the_rest_is_dimmed(shown: dict[int, Shown]) -> None:
    look = Look(answers=(2, 1))
    assert style_of(shown[2], look).color == BEST_COLOR
    assert style_of(shown[1], look).color == ANSWER_COLOR
    assert style_of(shown[3], look).opacity == DIMMED_OPACITY
    assert style_of(shown[3], replace(look, selected=3)).color == BEST_COLOR
    assert style_of(shown[3], replace(look, selected=3)).opacity is None


def test_colours_and_toggles(shown: dict[int, Shown]) -> None:
    assert style_of(shown[1], Look()).textured
    assert style_of(shown[1], Look(coloring="change")).color == (40, 175, 90)
    assert not style_of(shown[1], Look(hidden=frozenset({"cup"}))).visible
    assert not style_of(shown[2], Look(until=5)).visible
    assert style_of(shown[2], Look(until=6)).visible


def test_labels_are_escaped(shown: dict[int, Shown]) -> None:
    html = facts_html(shown[2], [b"\xff\xd8"])
    assert "<script" not in html
    assert "onerror=alert(1)&gt; · 2" in html
    assert "mug · 8" in html
    assert "cup (80%)" in html
    assert "data:image/jpeg;base64,/9g=" in html
    assert "No pictures" in facts_html(shown[1], [])
    assert "since</td><td>new" in facts_html(shown[1], [])
    assert "<script" not in answers_html(Answers(ids=(), said=(HOSTILE,)))


def test_prompts_are_answered_as_by_query(panoptic: PanopticMap) -> None:
    for content in (content_of(panoptic, "room"), live_content(panoptic, {})):
        answers = content.ask("mug")
        assert answers.ids[0] == 2
        assert answers.said[0].startswith("mug #2 (")
        nothing = content.ask("airplane")
        assert nothing.ids == ()
        assert nothing.said[0] == "nothing here matches"
        with pytest.raises(InputError):
            content.ask(" ")
    count = asked(panoptic, "how many cups are there")
    assert count.ids == (1, 2)
    assert "2 in all" in count.said


def test_views_are_outside_of_what_they_show(shown: dict[int, Shown]) -> None:
    up = np.array([0.0, 0.0, 1.0])
    eye, target = start_view(list(shown.values()), up)
    assert eye[2] > 1.5
    np.testing.assert_allclose(target, [0, 0, -0.05], atol=1e-9)
    for place in (eye, target + up):
        near, at = near_view(shown[2], place, up)
        np.testing.assert_allclose(at, [1, 0, 0], atol=1e-9)
        assert 1.0 < np.linalg.norm(near - at) < 3.0
        assert near[2] > 0.5


def test_path_is_lines_and_cameras() -> None:
    poses = [look_at([n, 0, 1], [n, 5, 1]) for n in range(3)]
    lines = path_lines(poses)
    assert lines.shape == (2 + 4 * 8, 2, 3)
    np.testing.assert_allclose(lines[:2], [[[0, 0, 1], [1, 0, 1]], [[1, 0, 1], [2, 0, 1]]])
    assert (lines[2:, :, 1] < 0.25).all()
