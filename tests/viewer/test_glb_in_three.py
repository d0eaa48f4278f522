"""The GLB of a map, loaded and drawn by three.js in a real browser."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.viewer.conftest import keep, until
from uppm.cli.export import write_mesh_file
from uppm.map.panoptic_map import PanopticMap, submap_dict

THREE = Path(sys.prefix) / "gltf" / "node_modules" / "three"
HOST = "http://three.test"
"""No such host: every request is answered by the test."""
PAGE = """<!doctype html><style>body { margin: 0 }</style>
<script type="importmap">{"imports": {"three": "/build/three.module.js"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "/examples/jsm/loaders/GLTFLoader.js";
const { scene: map } = await new GLTFLoader().loadAsync("/map.glb");
const meshes = map.children.filter((node) => node.isMesh);
window.found = Object.fromEntries(meshes.map((node) => {
  const at = new THREE.Box3().setFromObject(node);
  const { name, ...extras } = node.userData;
  return [name ?? node.name, {
    extras, low: at.min.toArray(), high: at.max.toArray(), faces: node.geometry.index.count / 3,
    colored: node.material.vertexColors && node.geometry.hasAttribute("color"),
  }];
}));
const scene = new THREE.Scene().add(map, new THREE.HemisphereLight(0xffffff, 0xffffff, 3));
scene.background = new THREE.Color(0xffffff);
const camera = new THREE.PerspectiveCamera(50, innerWidth / innerHeight, 0.1, 50);
camera.position.set(0, 1.6, 2.6);
camera.lookAt(0, 0, 0);
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);
renderer.render(scene, camera);
window.drawn = true;
</script>"""


def serve(page: Any, glb: Path) -> None:
    """Answer the page's requests with the page, the map, and three.js."""

    def answer(route: Any) -> None:
        path = route.request.url.removeprefix(HOST).lstrip("/")
        if not path:
            route.fulfill(body=PAGE, content_type="text/html")
        elif path == "map.glb":
            route.fulfill(path=glb, content_type="model/gltf-binary")
        else:
            route.fulfill(path=THREE / path, content_type="text/javascript")

    page.route("**/*", answer)


@pytest.mark.heavy
def test_three_loads_the_nodes_as_they_are(page: Any, panoptic: PanopticMap, tmp_path: Path) -> None:
    if not THREE.is_dir():
        pytest.skip("needs three.js: `make .venv/.gltf`, with npm")
    glb = tmp_path / "map.glb"
    write_mesh_file(panoptic, glb, "instance")
    serve(page, glb)
    page.goto(f"{HOST}/")
    until(page, "window.drawn === true")
    found = page.evaluate("window.found")
    assert sorted(found) == ["1_cup", "2_cup", "3_dining table", "4_floor-wood"]
    for name, node in found.items():
        id_ = int(name.split("_")[0])
        mesh = panoptic.submap_mesh(id_)
        # Its up is y: the map's (x, y, z) is (x, z, -y).
        turned = mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
        np.testing.assert_allclose(node["low"], turned.min(axis=0), atol=1e-4)
        np.testing.assert_allclose(node["high"], turned.max(axis=0), atol=1e-4)
        assert node["faces"] == len(mesh.faces)
        assert node["colored"]
        known = submap_dict(panoptic.submap(id_))
        assert {key: node["extras"][key] for key in known} == known
    picture = keep(page, "glb-in-three")
    assert (picture != 255).any(axis=-1).mean() > 0.05
