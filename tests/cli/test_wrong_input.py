"""Wrong input, given to the program: one line that says what to do, exit code 2, and every file as it was."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.conftest import Uppm
from tests.cli.room import write_precomputed
from tests.datasets.formats import scannet_sens
from tests.datasets.scene import image, pose, text
from uppm.core.geometry import invert

Args = list[object]
Case = tuple[Callable[[Path, Path], Args], str]
"""From the folder and the room in it, the arguments; and what the error says."""

MAP = ("--perception", "groundtruth", "--no-check")


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def mapping(*options: object) -> Callable[[Path, Path], Args]:
    return lambda folder, room: ["map", room, "-o", folder / "new.uppm", *options]


def broken(change: Callable[[Path], object], *options: object) -> Callable[[Path, Path], Args]:
    """Map the room after a change to it."""

    def case(folder: Path, room: Path) -> Args:
        change(room)
        return mapping(*options)(folder, room)

    return case


def truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def empty(room: Path) -> None:
    shutil.rmtree(room)
    room.mkdir()


def invert_poses(room: Path) -> None:
    for i, file in enumerate(sorted((room / "pose").iterdir())):
        file.write_text(text(invert(pose(i))))


def scale_intrinsics(room: Path) -> None:
    K = np.loadtxt(room / "intrinsics.txt")
    (room / "intrinsics.txt").write_text(text(np.diag([2, 2, 1]) @ K))


def scale_depth(room: Path) -> None:
    for file in (room / "depth").iterdir():
        depth = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        image(file, depth * 5)


def wrong_pose(value: str) -> Callable[[Path], object]:
    return lambda room: (room / "pose/00005.txt").write_text(" ".join([value] * 16))


def config(content: bytes) -> Callable[[Path, Path], Args]:
    def case(folder: Path, room: Path) -> Args:
        (folder / "c.yaml").write_bytes(content)
        return mapping("--config", folder / "c.yaml")(folder, room)

    return case


def sens(folder: Path, room: Path) -> Args:
    file = scannet_sens(folder / "scan") / "scene0000_00.sens"
    file.write_bytes(file.read_bytes()[:-5000])
    return mapping()(folder, file)


def precomputed_without_a_frame(folder: Path, room: Path) -> Args:
    ids = write_precomputed(folder / "ids", room)
    (ids / "00007.png").unlink()
    return mapping("--perception", "precomputed", "--precomputed", ids)(folder, room)


SEQUENCES: dict[str, Case] = {
    "no such path": (lambda folder, room: mapping()(folder, folder / "none"), "none: expected a sequence's folder"),
    "empty folder": (broken(empty), "found an empty folder; give the folder that holds these, convert"),
    "no depth": (broken(lambda room: shutil.rmtree(room / "depth")), "found no depth images but 12 colour images"),
    "no poses": (
        broken(lambda room: shutil.rmtree(room / "pose")),
        "pose: expected NNNNN.txt of 4x4 poses, found none",
    ),
    "no intrinsics": (broken(lambda room: (room / "intrinsics.txt").unlink()), "intrinsics.txt: expected a text file"),
    "intrinsics not 3x3": (
        broken(lambda room: (room / "intrinsics.txt").write_text("130 0 80 130")),
        "intrinsics.txt: expected a 3x3 matrix, found 4 numbers",
    ),
    "intrinsics of another resolution": (broken(scale_intrinsics), "--no-check"),
    "inverted poses": (broken(invert_poses), "use --invert-poses, or map it as it is with --no-check"),
    "depth scale": (broken(scale_depth), "use --depth-scale 5000, or map"),
    "truncated PNG": (
        broken(lambda room: truncate(room / "color/00003.png"), *MAP, "--strict"),
        "color/00003.png: expected an image, found a truncated or unreadable image; restore the file",
    ),
    "missing pose": (
        broken(lambda room: (room / "pose/00003.txt").unlink(), *MAP, "--strict"),
        "pose/00003.txt: expected a file, found a missing file",
    ),
    "NaN pose": (broken(wrong_pose("nan"), *MAP, "--strict"), "pose/00005.txt: expected .* found NaN or infinity"),
    "pose not rigid": (broken(wrong_pose("1"), *MAP, "--strict"), "found a pose that is not rigid"),
    "no ground truth": (
        broken(lambda room: (room / "labels.csv").unlink(), *MAP),
        "frame 0: expected ground truth, found none",
    ),
    "unknown format": (mapping("--format", "kitti"), "input.format: expected one of frames, 7scenes"),
    "another format": (mapping("--format", "tum"), "rgb.txt: expected"),
    "truncated .sens": (sens, "scene0000_00.sens: expected"),
    "precomputed without a folder": (mapping("--perception", "precomputed"), "perception.precomputed=FOLDER"),
    "precomputed folder missing": (
        mapping("--perception", "precomputed", "--precomputed", "none", "--no-check"),
        "none: expected a folder of id images, found no such folder",
    ),
    "precomputed image missing": (precomputed_without_a_frame, "00007.png: expected an id image of this frame"),
}

SETTINGS: dict[str, Case] = {
    "unknown profile": (mapping("--perception", "psychic"), "perception.profile: expected one of .*groundtruth"),
    "--set without =": (mapping("--set", "fusion.truncation"), "--set: expected section.name=value"),
    "--set of nothing": (mapping("--set", "fusion.trunc=3"), "expected a setting, found 'fusion.trunc'; see docs"),
    "--set of no section": (mapping("--set", "fussion.truncation=3"), "expected a setting, found 'fussion'"),
    "--set of a section": (mapping("--set", "fusion=3", "--set", "fusion.truncation=3"), "'?fusion"),
    "--set below a setting": (mapping("--set", "fusion.truncation.x=3"), "fusion.truncation"),
    "--set that is no YAML": (mapping("--set", "fusion.truncation=[3"), "--set: expected .*found 'fusion.truncation="),
    "--set of another type": (mapping("--set", "input.stride=two"), "expected a valid 'input.stride', found 'two'"),
    "out of range": (mapping("--set", "fusion.truncation=0"), "found 0 .*greater than or equal to 1"),
    "up axis": (mapping("--up", "z"), "expected a valid 'perception.up', found 'z'"),
    "settings file missing": (
        mapping("--config", "none.yaml"),
        "none.yaml: expected a YAML file, found .*No such file",
    ),
    "settings file not YAML": (config(b"fusion: [1"), "c.yaml: expected a YAML file"),
    "settings file not text": (config(b"\xff\xfe\x00"), "c.yaml: expected a YAML file"),
    "settings file a list": (config(b"- fusion"), "c.yaml: expected a YAML mapping, found list"),
    "unknown setting in a file": (config(b"fusion:\n  trunc: 3\n"), "c.yaml: expected a setting, found 'fusion.trunc'"),
    "section that is a number": (config(b"fusion: 3\n"), "c.yaml: expected a valid 'fusion'"),
}


def on_map(change: Callable[[Path], object], *arguments: object) -> Callable[[Path, Path], Args]:
    """A command on a map after a change to it; `{map}` stands for the map."""

    def case(folder: Path, room: Path) -> Args:
        path = folder / "room.uppm"
        change(path)
        return [str(path) if a == "{map}" else room if a == "{room}" else a for a in arguments]

    return case


def corrupt(path: Path) -> None:
    path.write_bytes(b"no map at all" * 1000)


def newer(path: Path) -> None:
    with sqlite3.connect(path) as db:
        db.execute("PRAGMA user_version = 99")
    db.close()


def keep(path: Path) -> None:
    """No change."""


def shorter(path: Path) -> None:
    for file in path.parent.glob("room/color/0001?.png"):
        file.unlink()
    for file in path.parent.glob("room/depth/0001?.png"):
        file.unlink()


EVALUATE = ("evaluate", "map", "{map}", "--ground-truth", "{room}")
INFO, QUERY = ("info", "{map}"), ("query", "{map}", "ball")
RESUME = ("map", "{room}", "-o", "{map}", "--resume")
MAPS: dict[str, Case] = {
    "missing map": (on_map(Path.unlink, *INFO), "room.uppm: expected a map file, found nothing there"),
    "folder as map": (on_map(keep, "info", "."), "expected a map file, found a folder"),
    "corrupt map": (on_map(corrupt, *INFO), "found another kind of file; name a file written by `uppm map`"),
    "corrupt map asked": (on_map(corrupt, *QUERY), "found another kind of file"),
    "corrupt map resumed": (on_map(corrupt, *RESUME), "found another kind of file"),
    "truncated map": (on_map(truncate, *INFO), "found a truncated or damaged one"),
    "truncated map measured": (
        on_map(truncate, *EVALUATE),
        "found a truncated or damaged one",
    ),
    "truncated map resumed": (on_map(truncate, *RESUME), "found a truncated or damaged one"),
    "newer map": (on_map(newer, *INFO), "expected map schema [0-9]+ or older, found schema 99; update uppm"),
    "newer map resumed": (on_map(newer, *RESUME), "found schema 99; update uppm"),
    "query without words": (on_map(keep, "query", "{map}", ""), "expected"),
    "query of blanks": (on_map(keep, "query", "{map}", "  "), "expected"),
    "export of nothing": (on_map(keep, "export", "{map}"), "--mesh, --points, .*--costmap or --esdf"),
    "export to no folder": (on_map(keep, "export", "{map}", "--mesh", "no/a.ply"), "no: expected a folder"),
    "export to another kind": (on_map(keep, "export", "{map}", "--mesh", "a.stl"), "a.stl: expected .*ply"),
    "output exists": (on_map(keep, "map", "{room}", "-o", "{map}"), "use --resume to go on with it or --overwrite"),
    "output is a folder": (on_map(keep, "map", "{room}", "-o", "."), "expected a file name for the map"),
    "output folder missing": (on_map(keep, "map", "{room}", "-o", "no/a.uppm"), "no: expected a folder, found nothing"),
    "resume of nothing": (on_map(Path.unlink, *RESUME), "room.uppm: expected a map file, found nothing there"),
    "resume and overwrite": (on_map(keep, *RESUME, "--overwrite"), "expected one of --resume and --overwrite"),
    "resume with another sequence": (on_map(shorter, *RESUME), r"begun with \(room, 12 frames\), found room, 10"),
    "resume with other settings": (
        on_map(keep, *RESUME, "--set", "fusion.truncation=3"),
        "expected the map's own fusion.truncation, 2.0, found 3.0",
    ),
    "evaluate without a surface": (
        on_map(lambda path: (path.parent / "room/surface.npz").unlink(), *EVALUATE),
        "surface.npz: expected arrays xyz_mm .* found no such file",
    ),
    "evaluate what is no mesh": (
        on_map(
            lambda path: path.with_suffix(".ply").write_text("ply"),
            *("evaluate", "map", "room.ply", "--ground-truth", "{room}"),
        ),
        "room.ply: expected",
    ),
    "retrieval without labels": (on_map(keep, "evaluate", "retrieval", "none.tsv"), "none.tsv: expected"),
}  # fmt: skip


CASES = SEQUENCES | SETTINGS | MAPS


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_one_line(
    uppm: Uppm, room: Path, tmp_path: Path, map_file: Path, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copyfile(map_file, tmp_path / "room.uppm")
    arguments = case[0](tmp_path, room)
    before = files(tmp_path)
    done = uppm(*arguments)
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert re.search(rf"^error: .*{case[1]}", done.err), done.err
    assert files(tmp_path) == before
