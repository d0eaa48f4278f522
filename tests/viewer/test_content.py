"""What the viewers show, and the arrays of the exported page read back."""

from __future__ import annotations

import base64
import json
import re
import zlib

import numpy as np
import pytest

from tests.viewer.conftest import HOSTILE
from uppm.core.errors import InputError
from uppm.core.shown import COLORINGS
from uppm.map.panoptic_map import PanopticMap
from uppm.map.shown import confidence_color, content_of
from uppm.viewer.facts import changes_html
from uppm.viewer.html import STEPS, map_page


def test_shown_are_surfaces_with_facts(panoptic: PanopticMap) -> None:
    content = {shown.submap.id: shown for shown in content_of(panoptic, "room").shown}
    assert {id_: shown.name for id_, shown in content.items()} == {
        1: "cup", 2: "mug", 3: "dining table", 4: "floor wood",
    }  # fmt: skip
    facts = content[2].facts
    assert facts["labels"] == {"mug": 8, HOSTILE: 2}
    assert (facts["category"], facts["confidence"], facts["voxel_size"]) == ("cup", 0.8, 0.02)
    assert (facts["first_frame"], facts["last_frame"], facts["views"]) == (6, 9, 5)
    assert content[1].facts["change"]["state"] == "new"
    assert content[2].facts["change"] is None


def test_colors(panoptic: PanopticMap) -> None:
    one, two, *_ = content_of(panoptic, "room").shown
    differ = {name: one.colors[name] != two.colors[name] for name in COLORINGS if name != "texture"}
    assert differ == {"instance": True, "category": False, "confidence": True, "change": True}
    assert confidence_color(0.0) == (68, 1, 84)
    assert confidence_color(0.75) == (143, 188, 88)


def test_freespace_is_what_was_seen_free(panoptic: PanopticMap) -> None:
    points = content_of(panoptic, "room").free
    assert len(points) > 1000
    assert points[:, 2].min() > 0


def test_path_is_in_order(panoptic: PanopticMap) -> None:
    assert [index for index, _ in content_of(panoptic, "room").path] == list(range(10))


def test_what_an_older_map_had_is_listed(panoptic: PanopticMap) -> None:
    """Counts by state, and those that are gone; nothing for a map that was compared with none."""
    content = content_of(panoptic, "room")
    html = changes_html(content.shown, content.gone)
    assert "new · 1" in html
    assert "absent · 1" in html
    assert "cup #8: absent" in html
    assert "persistent" not in html
    hostile = {**content.gone[0], "label": HOSTILE}
    assert "<img" not in changes_html(content.shown, [hostile])
    assert changes_html(content.shown[1:], ()) == ""


def test_page_holds_the_map(panoptic: PanopticMap) -> None:
    page = map_page(content_of(panoptic, "a <b>"), {1: [b"jpeg"]})
    assert "<title>a &lt;b></title>" in page
    assert page.count("</script>") == 3
    assert re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", page) is None
    header = json.loads(page.split('id="header">')[1].split("</script>")[0])
    data = zlib.decompress(base64.b64decode(page.split('id="data">')[1].split("</script>")[0]))
    content = content_of(panoptic, "room").shown
    assert [o["id"] for o in header["objects"]] == [1, 2, 3, 4]
    assert base64.b64decode(header["objects"][0]["crops"][0]) == b"jpeg"
    assert [gone["state"] for gone in header["gone"]] == ["absent"]
    corners = np.concatenate([shown.mesh.faces.ravel() for shown in content])
    stored = np.frombuffer(data, "<i4", len(corners))
    ends = np.cumsum([shown.mesh.faces.size for shown in content])[:-1]
    np.testing.assert_array_equal(np.concatenate([np.cumsum(part) for part in np.split(stored, ends)]), corners)
    steps = np.frombuffer(data, "<u2", offset=4 * len(corners))
    first = content[0].mesh.vertices
    box = header["objects"][0]
    found = np.array(box["low"]) + steps[: first.size].reshape(-1, 3) * np.array(box["step"])
    np.testing.assert_allclose(found, first, atol=float(np.ptp(first, axis=0).max()) / STEPS)


def test_a_map_without_surfaces_has_no_page() -> None:
    class NoVoxels:
        def blocks(self, submap_id: int) -> None: ...

    empty = PanopticMap(submaps=(), voxels=NoVoxels())  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="a map with surfaces"):
        map_page(content_of(empty, "empty"))
