"""The rendered room written exactly as each dataset's files are."""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np

from tests.datasets import bags
from tests.datasets.scene import CAMERA, image, pose, quaternion, render, text, write_frames, write_tum
from uppm.core.types import Intrinsics

COUNT = 4
DEPTH_CAMERA = Intrinsics(fx=85, fy=84, cx=50, cy=38, width=100, height=76)
"""A coarser depth camera beside the colour camera."""
T_COLOR_DEPTH = np.array([[1, 0, 0, 0.03], [0, 1, 0, -0.01], [0, 0, 1, 0.005], [0, 0, 0, 1.0]])


def millimetres(depth: np.ndarray) -> np.ndarray:
    return np.rint(depth * 1000).astype(np.uint16)


def depth_camera(i: int) -> np.ndarray:
    return millimetres(render(pose(i) @ T_COLOR_DEPTH, DEPTH_CAMERA)[1])


def square(K: np.ndarray) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = K
    return out


def frames(root: Path) -> Path:
    return write_frames(root, count=COUNT)


def tum(root: Path) -> Path:
    return write_tum(root, count=COUNT)


def seven_scenes(root: Path) -> Path:
    root.mkdir()
    for i in range(COUNT):
        color, depth = render(pose(i))
        stored = millimetres(depth)
        stored[:2], stored[2:4] = 0, 65535
        image(root / f"frame-{i:06d}.color.png", color)
        image(root / f"frame-{i:06d}.depth.png", stored)
        (root / f"frame-{i:06d}.pose.txt").write_text(text(pose(i)))
    (root / "camera-intrinsics.txt").write_text(text(CAMERA.matrix))
    return root


def hololens(root: Path) -> Path:
    """Images numbered by every fourth frame; line i of poses.txt is that of the i-th image."""
    for i in range(COUNT):
        color, depth = render(pose(i))
        image(root / f"images/{4 * i + 3:05d}.png", color)
        image(root / f"depth/{4 * i + 3:05d}.png", millimetres(depth))
    (root / "poses.txt").write_text(text([pose(i).ravel() for i in range(COUNT)]))
    (root / "K.txt").write_text(text(CAMERA.matrix))
    return root


def replica(root: Path) -> Path:
    root = root / "office0"
    for i in range(COUNT):
        color, depth = render(pose(i))
        image(root / f"results/frame{i:06d}.jpg", color)
        image(root / f"results/depth{i:06d}.png", np.rint(depth * 6553.5).astype(np.uint16))
    (root / "traj.txt").write_text(text([pose(i).ravel() for i in range(COUNT)]))
    keys = {"w": CAMERA.width, "h": CAMERA.height, "fx": CAMERA.fx, "fy": CAMERA.fy, "cx": CAMERA.cx, "cy": CAMERA.cy}
    (root.parent / "cam_params.json").write_text(json.dumps({"camera": {**keys, "scale": 6553.5}}))
    return root


def scannet_folders(root: Path) -> Path:
    for i in range(COUNT):
        image(root / f"color/{i}.jpg", render(pose(i))[0])
        image(root / f"depth/{i}.png", depth_camera(i))
    for folder in ("pose", "intrinsic"):
        (root / folder).mkdir()
    for i in range(COUNT):
        (root / f"pose/{i}.txt").write_text(text(pose(i)))
    for name, matrix in _calibration().items():
        (root / f"intrinsic/{name}.txt").write_text(text(matrix))
    return root


def _calibration() -> dict[str, np.ndarray]:
    return {
        "intrinsic_color": square(CAMERA.matrix),
        "extrinsic_color": np.eye(4),
        "intrinsic_depth": square(DEPTH_CAMERA.matrix),
        "extrinsic_depth": T_COLOR_DEPTH,
    }


def scannet_sens(root: Path, lost: int | None = None) -> Path:
    """Version 4: JPEG colour, zlib 16-bit depth; frame `lost` has the infinite pose of a lost track."""
    root.mkdir()
    name = b"StructureSensor"
    parts = [struct.pack("<IQ", 4, len(name)), name]
    parts += [matrix.astype("<f4").tobytes() for matrix in _calibration().values()]
    parts.append(
        struct.pack("<2i4IfQ", 2, 1, CAMERA.width, CAMERA.height, DEPTH_CAMERA.width, DEPTH_CAMERA.height, 1000, COUNT)
    )
    for i in range(COUNT):
        jpeg = cv2.imencode(".jpg", render(pose(i))[0][..., ::-1])[1].tobytes()
        depth = zlib.compress(depth_camera(i).astype("<u2").tobytes())
        T = np.full((4, 4), -np.inf) if i == lost else pose(i)
        stamps = (33_333 * i, 33_333 * i)
        parts += [T.astype("<f4").tobytes(), struct.pack("<4Q", *stamps, len(jpeg), len(depth)), jpeg, depth]
    parts.append(struct.pack("<Q", 0))
    (root / "scene0000_00.sens").write_bytes(b"".join(parts))
    return root


def three_rscan(root: Path) -> Path:
    folder = root / "sequence"
    for i in range(COUNT):
        image(folder / f"frame-{i:06d}.color.jpg", render(pose(i))[0])
        image(folder / f"frame-{i:06d}.depth.pgm", depth_camera(i))
        (folder / f"frame-{i:06d}.pose.txt").write_text(text(pose(i)))
    names = {"intrinsic_color": "ColorIntrinsic", "extrinsic_color": "ColorExtrinsic"}
    names |= {"intrinsic_depth": "DepthIntrinsic", "extrinsic_depth": "DepthExtrinsic"}
    lines = ["m_versionNumber = 4", "m_sensorName = RGB-D Sensor"]
    for kind, camera in (("color", CAMERA), ("depth", DEPTH_CAMERA)):
        lines += [f"m_{kind}Width = {camera.width}", f"m_{kind}Height = {camera.height}"]
    lines.append("m_depthShift = 1000")
    for name, matrix in _calibration().items():
        lines.append(f"m_calibration{names[name]} = {' '.join(f'{value:g}' for value in matrix.ravel())} ")
    lines.append(f"m_frames.size = {COUNT}")
    (folder / "_info.txt").write_text("\n".join(lines) + "\n")
    return root


def three_rscan_zip(root: Path) -> Path:
    folder = three_rscan(root) / "sequence"
    with zipfile.ZipFile(root / "sequence.zip", "w") as archive:
        for file in sorted(folder.iterdir()):
            archive.write(file, file.name)
            file.unlink()
    folder.rmdir()
    return root


def panmap_flat(root: Path) -> Path:
    root = root / "run1"
    (root).mkdir(parents=True)
    lines = ["ImageID,TimeStamp"]
    for i in range(COUNT):
        color, depth = render(pose(i))
        image(root / f"{i:06d}_color.png", color)
        image(root / f"{i:06d}_depth.tiff", depth)
        image(root / f"{i:06d}_segmentation.png", np.where(depth > np.median(depth), 7, 9).astype(np.uint8))
        image(root / f"{i:06d}_predicted.png", np.zeros_like(depth, dtype=np.uint8))
        (root / f"{i:06d}_labels.json").write_text("[]")
        (root / f"{i:06d}_pose.txt").write_text(text(pose(i)))
        lines.append(f"{i:06d},{1_600_000_000_000_000_000 + i * 100_000_000}")
    (root / "timestamps.csv").write_text("\n".join(lines) + "\n")
    (root / "intrinsics.txt").write_text(text(CAMERA.matrix))
    (root.parent / "groundtruth_labels.csv").write_text("InstanceID,ClassID,PanopticID,Name\n7,1,0,wall\n9,2,1,chair\n")
    return root


def bag(root: Path) -> Path:
    return bags.write(root, bags.room(bags.Maker(ros1=False)), mcap=True)


def quaternion_first(T: np.ndarray) -> list[float]:
    """As Record3D writes a pose: x, y, z, w, then the place, of a camera with y up and z backward."""
    return [*quaternion(T @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist(), *T[:3, 3].tolist()]


def record3d(root: Path, *, columns: bool = True, **metadata: object) -> Path:
    """The app's zip; depth at half the size, of every other pixel's place."""
    from lzfse import compress

    half = Intrinsics(fx=65, fy=65, cx=39.5, cy=29.5, width=80, height=60)
    K = CAMERA.matrix.T if columns else CAMERA.matrix
    about = {"w": CAMERA.width, "h": CAMERA.height, "K": K.ravel().tolist(), "fps": 30, "dw": 80, "dh": 60}
    about |= {"poses": [quaternion_first(pose(i)) for i in range(COUNT)]}
    path = root.with_suffix(".r3d")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata", json.dumps(about | metadata))
        for i in range(COUNT):
            color = cv2.imencode(".jpg", render(pose(i))[0][..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])[1]
            archive.writestr(f"rgbd/{i}.jpg", color.tobytes())
            archive.writestr(f"rgbd/{i}.depth", compress(render(pose(i), half)[1].astype("<f4").tobytes()))
            archive.writestr(f"rgbd/{i}.conf", compress(np.full(80 * 60, 2, np.uint8).tobytes()))
    return path


def write_video(path: Path, images: list[np.ndarray]) -> None:
    """FFV1, lossless: colour (H, W, 3) RGB or depth (H, W) uint16."""
    color = images[0].ndim == 3
    height, width = images[0].shape[:2]
    options = [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_8U if color else cv2.CV_16U, cv2.VIDEOWRITER_PROP_IS_COLOR, color]
    code = cv2.VideoWriter.fourcc(*"FFV1")
    video = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 30.0, (width, height), [int(o) for o in options])
    assert video.isOpened()
    for picture in images:
        video.write(picture[..., ::-1] if color else picture)
    video.release()


def video(root: Path) -> Path:
    root.mkdir()
    frames = [render(pose(i)) for i in range(COUNT)]
    write_video(root / "color.mkv", [color for color, _ in frames])
    write_video(root / "depth.mkv", [millimetres(depth) for _, depth in frames])
    (root / "poses.txt").write_text("".join(text(pose(i).reshape(1, 16)) for i in range(COUNT)))
    (root / "intrinsics.txt").write_text(text(CAMERA.matrix))
    return root


FORMATS = {
    "frames": (frames, "frames"),
    "7scenes": (seven_scenes, "7scenes"),
    "hololens": (hololens, "hololens"),
    "tum": (tum, "tum"),
    "replica": (replica, "replica"),
    "scannet folders": (scannet_folders, "scannet"),
    "scannet sens": (scannet_sens, "scannet"),
    "3rscan": (three_rscan, "3rscan"),
    "3rscan zip": (three_rscan_zip, "3rscan"),
    "panmap-flat": (panmap_flat, "panmap-flat"),
    "record3d": (record3d, "record3d"),
    "video": (video, "video"),
    "bag": (bag, "bag"),
}
