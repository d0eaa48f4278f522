"""A colour video with depth: the ways in which it may be given, and what is wrong with one."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import uppm
from tests.datasets import formats, scene
from tests.datasets.test_bad_input import bad_frame, refused
from uppm.datasets import check_sequence, open_sequence


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return formats.video(tmp_path / "room")


def test_it_passes_the_check_and_maps(room: Path, tmp_path: Path) -> None:
    source = open_sequence(room)
    result = check_sequence(source)
    assert result.ok, result.findings
    config = uppm.Config.load(None, ["fusion.max_blocks=20000"])
    uppm.map_sequence(source, tmp_path / "room.uppm", config)
    assert len(uppm.open_map(tmp_path / "room.uppm").mesh().faces) > 1000


def test_frames_may_be_read_in_any_order(room: Path) -> None:
    source = open_sequence(room)
    in_order = [source.frame(i) for i in range(formats.COUNT)]
    for i in (2, 2, 0, 3, 1):
        np.testing.assert_array_equal(source.frame(i).color, in_order[i].color)
        np.testing.assert_array_equal(source.frame(i).depth, in_order[i].depth)
        np.testing.assert_array_equal(in_order[i].color, scene.render(scene.pose(i))[0])
        np.testing.assert_allclose(in_order[i].depth, scene.render(scene.pose(i))[1], atol=0.0006)


def test_depth_images_and_a_trajectory_by_time(room: Path) -> None:
    (room / "depth.mkv").unlink()
    for i in (0, 1, 3):
        depth = scene.render(scene.pose(i))[1]
        scene.image(room / f"depth/{i}.png", np.rint(depth * 1000).astype(np.uint16))
    stamps = [100.0, 100.1, 100.2, 100.3]
    (room / "stamps.txt").write_text("\n".join(map(str, stamps)) + "\n")
    (room / "poses.txt").unlink()
    lines = [
        f"{stamps[i] + 0.004} {' '.join(map(str, (*scene.pose(i)[:3, 3], *scene.quaternion(scene.pose(i)))))}"
        for i in (0, 1)
    ]
    (room / "trajectory.txt").write_text("# time tx ty tz qx qy qz qw\n" + "\n".join(lines) + "\n")
    source = open_sequence(room)
    assert [source.raw.frames[i].stamp for i in range(len(source))] == [100.0, 100.1, 100.3]
    for i in (0, 1):
        np.testing.assert_allclose(source.frame(i).T_map_camera, scene.pose(i), atol=1e-6)
    assert bad_frame(room, index=2).found == "no pose"
    (room / "stamps.txt").unlink()
    message = refused(room)
    assert "trajectory.txt: expected poses within 0.02 s of the frames, found times 100.004 to 100.104 s" in message


def test_a_video_that_ends_early_gives_bad_frames(room: Path) -> None:
    data = (room / "color.mkv").read_bytes()
    (room / "color.mkv").write_bytes(data[: len(data) // 2])
    source = open_sequence(room, uppm.Config().input)
    source.frame(0)
    assert bad_frame(room, index=len(source) - 1).found == "a truncated or unreadable video"


def test_depth_of_8_bit_is_refused(room: Path) -> None:
    shutil.copyfile(room / "color.mkv", room / "depth.mkv")
    assert "expected depth of 16 bit in one channel, found an image of uint8 with" in refused(room)


def test_wrong_input_is_one_line(room: Path, tmp_path: Path) -> None:
    for name, said in (
        ("poses.txt", "poses.txt: expected a text file, found nothing there"),
        ("intrinsics.txt", "intrinsics.txt: expected a text file, found nothing there"),
        ("depth.mkv", "expected depth images or a depth video, found neither"),
    ):
        broken = Path(shutil.copytree(room, tmp_path / f"without {name}"))
        (broken / name).unlink()
        assert said in refused(broken)
    (room / "poses.txt").write_text(scene.text(scene.pose(0).reshape(1, 16)))
    assert "expected 4 lines, one for each image, found 1 lines" in refused(room)
    small = cv2.resize(np.zeros((120, 160), np.uint16), (80, 60))
    scene.image(tmp_path / "other/depth/0.png", small)
    shutil.copytree(room, tmp_path / "other", dirs_exist_ok=True)
    (tmp_path / "other/poses.txt").write_text("".join(scene.text(scene.pose(i).reshape(1, 16)) for i in range(4)))
    assert "expected colour and depth of one size, found colour of 160x120 and depth of 80x60" in refused(
        tmp_path / "other"
    )
    (room / "color.mkv").write_bytes(b"no video")
    assert "color.mkv: expected a video that OpenCV reads, found another file" in refused(room)
