"""The example node, on stand-ins for rclpy: they register callbacks and hold parameters, and do nothing else of ROS.

That the node works on a real ROS graph is not shown here.
"""

from __future__ import annotations

import importlib.util
import sys
from array import array
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="pip install uppm[ros] brings rosbags, which has ROS's messages without ROS")
import uppm
from tests.datasets import bags
from tests.datasets.scene import CAMERA, pose, render
from uppm.core.errors import InputError

FILE = Path(__file__).resolve().parents[1] / "examples" / "ros2_mapping_node.py"
TOPICS = {
    "/camera/color/image_raw": "/camera/color/image_raw",
    "/camera/depth/image_rect": "/camera/aligned_depth_to_color/image_raw",
    "/camera/color/camera_info": "/camera/color/camera_info",
    "/tf": "/tf",
    "/tf_static": "/tf_static",
}
"""Topics of the tests' bags -> those that the node listens to."""


class StandInNode:
    """What the example uses of rclpy.node.Node."""

    given: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self, name: str) -> None:
        self.name, self.callbacks, self.log = name, {}, []

    def declare_parameter(self, name: str, value: Any) -> SimpleNamespace:
        return SimpleNamespace(value=self.given.get(name, value))

    def create_subscription(self, kind: type, topic: str, callback: Callable[[Any], None], qos: Any) -> None:
        self.callbacks[topic] = callback

    def create_timer(self, period: float, callback: Callable[[], None]) -> None:
        self.callbacks["timer"] = callback

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(info=self.log.append)

    def destroy_node(self) -> None:
        self.callbacks.clear()


def module(name: str, **contents: Any) -> ModuleType:
    made = ModuleType(name)
    vars(made).update(contents)
    return made


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The example, imported over the stand-ins."""
    kinds = {name: type(name, (), {}) for name in ("CameraInfo", "CompressedImage", "Image", "TFMessage")}
    stand_ins = (
        module("rclpy", init=lambda: None, spin=lambda node: None, try_shutdown=lambda: None),
        module("rclpy.executors", ExternalShutdownException=type("ExternalShutdownException", (Exception,), {})),
        module("rclpy.node", Node=StandInNode),
        module(
            "rclpy.qos",
            DurabilityPolicy=SimpleNamespace(TRANSIENT_LOCAL=1),
            QoSProfile=SimpleNamespace,
            qos_profile_sensor_data=None,
        ),
        module("sensor_msgs"),
        module("sensor_msgs.msg", **kinds),
        module("tf2_msgs"),
        module("tf2_msgs.msg", TFMessage=kinds["TFMessage"]),
    )
    for each in stand_ins:
        monkeypatch.setitem(sys.modules, each.__name__, each)
    spec = importlib.util.spec_from_file_location("ros2_mapping_node", FILE)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.fixture
def node(example: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    given = {"output": str(tmp_path / "run.uppm"), "policy": "block"}
    monkeypatch.setattr(StandInNode, "given", given)
    return example.MappingNode()


def messages() -> list[bags.Message]:
    """The room as a robot publishes it, in the order of arrival."""
    return sorted(bags.room(bags.Maker(ros1=False)), key=lambda each: each[2])


def play(node: Any, told: list[bags.Message]) -> None:
    for topic, _, _, message in told:
        if topic in TOPICS:
            if hasattr(message, "step"):
                message.data = array("B", message.data.tobytes())  # rclpy has no NumPy arrays there
            node.callbacks[TOPICS[topic]](message)


def test_what_is_published_is_mapped(node: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[uppm.Frame] = []
    push = node.live.push
    monkeypatch.setattr(node.live, "push", lambda frame: seen.append(frame) or push(frame))
    play(node, messages())
    node.live.close()
    assert [frame.index for frame in seen] == list(range(bags.COUNT))
    for i, frame in enumerate(seen):
        color, depth = render(pose(i))
        np.testing.assert_array_equal(frame.color, color)
        np.testing.assert_allclose(frame.depth, depth, atol=0.0006)
        np.testing.assert_allclose(frame.T_map_camera, pose(i), atol=1e-6)
        assert frame.intrinsics == CAMERA
    assert uppm.open_map(tmp_path / "run.uppm").report.frames == bags.COUNT
    node.report()
    assert f"{bags.COUNT} frames mapped, 0 skipped, 0 dropped, 0 waiting" in node.log[-1]
    assert "0 depth images without colour, 0 without a pose" in node.log[-1]


def test_images_wait_for_transforms_that_come_late(node: Any) -> None:
    told = messages()
    images = [each for each in told if not each[0].startswith("/tf")]
    play(node, images)
    assert node.live.statistics.received == 0
    play(node, [each for each in told if each[0].startswith("/tf")])
    node.live.close()
    assert (node.live.statistics.received, node.without_pose) == (bags.COUNT, 0)


def test_what_has_no_partner_is_counted(node: Any) -> None:
    start = bags.START
    told = [each for each in messages() if each[0] != "/camera/color/image_raw" or each[2] > start + 0.15]
    told = [each for each in told if each[0] != "/tf" or each[2] < start + 0.25]
    play(node, told)
    node._set["patience"] = 0.05
    play(node, [told[-1]])
    node.live.close()
    assert node.without_color == 2
    assert (node.live.statistics.received, node.without_pose) == (1, 0)
    m = bags.Maker(ros1=False)
    late = m.image(start + 9, "camera", "rgb8", render(pose(0))[0])
    node.on_color(late)
    node._push_ready()
    assert node.without_pose == 1


def test_depth_of_another_camera_is_refused(node: Any) -> None:
    m = bags.Maker(ros1=False)
    told = [each for each in messages() if each[0] != "/camera/depth/image_rect"]
    small = m.image(bags.START, "camera", "16UC1", np.ones((60, 80), np.uint16))
    play(node, told)
    with pytest.raises(InputError, match="expected depth of 160x120, found 80x60 of 16UC1; subscribe to depth that is"):
        node.on_depth(small)
    with pytest.raises(InputError, match="live mapping: expected frames that can be used, found none"):
        node.live.close()


def test_it_ends_with_the_map_written(example: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.uppm"
    monkeypatch.setattr(StandInNode, "given", {"output": str(path), "policy": "block"})

    def spin(node: Any) -> None:
        play(node, messages())
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["rclpy"], "spin", spin)
    example.main()
    assert uppm.open_map(path).report.frames == bags.COUNT
