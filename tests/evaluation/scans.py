"""A small room of two quads written exactly as each data set's annotated scan is."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

CORNERS = np.array(
    [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0.5, 0.5, 0.4], [1, 0.5, 0.4], [1, 1, 0.4], [0.5, 1, 0.4]],
    dtype=np.float32,
)
"""Metres: a floor of 4 m2, and a table of a quarter over it."""
TRIANGLES = ((0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7))


def scannet(root: Path, label: str = "coffee table") -> Path:
    """`scene0000_00` in a folder, the table of labels one folder up; the table is one segment, the floor two."""
    scan = root / "scans" / "scene0000_00"
    scan.mkdir(parents=True)
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = b"".join(struct.pack("<3f4B", *map(float, c), 9, 9, 9, 255) for c in CORNERS)
    faces = b"".join(struct.pack("<B3i", 3, *t) for t in TRIANGLES)
    (scan / "scene0000_00_vh_clean_2.ply").write_bytes(header.encode() + vertices + faces)
    segments = {"sceneId": "scene0000_00", "segIndices": [5, 5, 8, 8, 31, 31, 31, 31]}
    (scan / "scene0000_00_vh_clean_2.0.010000.segs.json").write_text(json.dumps(segments))
    groups = [
        {"id": 0, "objectId": 0, "segments": [5, 8], "label": "floor"},
        {"id": 1, "objectId": 1, "segments": [31], "label": label},
    ]
    (scan / "scene0000_00.aggregation.json").write_text(json.dumps({"sceneId": "x", "segGroups": groups}))
    rows = ["id\traw_category\tcategory\tcount\tnyu40id\teigen13id\tnyuClass\tnyu40class"]
    rows += ["2\tfloor\tfloor\t1553\t2\t5\tfloor\tfloor", "40\tcoffee table\tcoffee table\t300\t7\t10\ttable\ttable"]
    rows += ["99\tdesk organizer thing\tx\t1\t14\t10\tdesk\tdesk", "7\tgadget\tx\t1\t40\t7\totherprop\totherprop"]
    (root / "scannetv2-labels.combined.tsv").write_text("\n".join(rows) + "\n")
    return scan


def three_rscan(root: Path) -> Path:
    """A scan's folder with its ASCII mesh, objects.json one folder up."""
    scan = root / "4acaebcc-6c10-2a2a-858b-29c7e4fb410d"
    scan.mkdir(parents=True)
    lines = ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {axis}" for axis in "xyz")]
    lines += [f"property uchar {c}" for c in ("red", "green", "blue")]
    lines += ["property ushort objectId", "property ushort globalId", *_bytes("NYU40", "Eigen13", "RIO27")]
    lines += ["element face 4", "property list uchar uint vertex_indices", "end_header"]
    ids = [1, 1, 1, 1, 12, 12, 12, 12]
    lines += [f"{x:.6f} {y:.6f} {z:.6f} 1 2 3 {i} 4 2 5 2" for (x, y, z), i in zip(CORNERS, ids, strict=True)]
    lines += [" ".join(map(str, (3, *t))) for t in TRIANGLES]
    (scan / "labels.instances.annotated.v2.ply").write_text("\n".join(lines) + "\n")
    objects = [
        {"id": "1", "label": "floor", "nyu40": "2", "global_id": "4"},
        {"id": "12", "label": "couch table", "nyu40": "7", "global_id": "9"},
    ]
    (root / "objects.json").write_text(json.dumps({"scans": [{"scan": scan.name, "objects": objects}]}))
    return scan


def _bytes(*names: str) -> list[str]:
    return [f"property uchar {name}" for name in names]


def replica(root: Path) -> Path:
    """A scene with quads and an object id a face."""
    (root / "habitat").mkdir(parents=True)
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 2\nproperty list uchar int vertex_indices\nproperty int object_id\nend_header\n"
    )
    faces = struct.pack("<B4ii", 4, 0, 1, 2, 3, 0) + struct.pack("<B4ii", 4, 4, 5, 6, 7, 21)
    (root / "habitat" / "mesh_semantic.ply").write_bytes(header.encode() + CORNERS.tobytes() + faces)
    objects = [{"id": 0, "class_id": 40, "class_name": "floor"}, {"id": 21, "class_id": 80, "class_name": "table"}]
    content = {"classes": [], "id_to_label": [], "objects": [*objects, {"id": 5, "class_name": "undefined"}]}
    (root / "habitat" / "info_semantic.json").write_text(json.dumps(content))
    return root


def panmap_flat(root: Path) -> Path:
    """`run1` without frames; the cloud in ground_truth/run1, the table of labels beside the runs."""
    run, truth = root / "run1", root / "ground_truth" / "run1"
    run.mkdir(parents=True)
    truth.mkdir(parents=True)
    points = np.concatenate([CORNERS, CORNERS + np.float32(0.01)])
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property float {a}" for a in "xyz")]
    lines += ["end_header", *(" ".join(f"{v:.6f}" for v in p) for p in points)]
    (truth / "flat_1_gt_10000.ply").write_text("\n".join(lines) + "\n")
    rows = ["InstanceID,ClassID,PanopticID,MeshID,InfraredID,R,G,B,Name,Size", "3,1,0,7,20,0,0,0,Floor,L"]
    rows += ["9,4,1,8,21,0,0,0,Coffee table 2,M", "11,5,1,9,22,0,0,0,Gizmo,S"]
    (root / "groundtruth_labels.csv").write_text("\n".join(rows) + "\n")
    return run
