"""Write src/uppm/data/mpnet.onnx: all-mpnet-base-v2's network without its weights.

Song et al. 2020, MPNet: 12 post-norm transformer layers, one relative position bias shared by all of them;
then the mean over the tokens and the L2 norm. One text a run, so that a text's vector never depends on its neighbours.
Each weight is an initializer named as in model.safetensors, given at load time. Needs `onnx` (in requirements/dev.txt):

    python tools/make_mpnet_graph.py
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from onnx import ModelProto, NodeProto, TensorProto, helper

LAYERS, HEADS, WIDTH, INNER, VOCABULARY, POSITIONS, BUCKETS = 12, 12, 768, 3072, 30527, 514, 32
EPSILON = 1e-5
OPSET = 17


class Graph:
    """Nodes and weights as they are added; a value is known by its name."""

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.initializers: list[TensorProto] = []

    def add(self, op: str, *inputs: str, **attributes: Any) -> str:
        name = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(op, inputs, [name], **attributes))
        return name

    def weight(self, name: str, *shape: int) -> str:
        tensor = TensorProto(name=name, data_type=TensorProto.FLOAT, dims=shape)
        tensor.data_location = TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="model.safetensors")
        self.initializers.append(tensor)
        return name

    def constant(self, *values: float, kind: int = TensorProto.INT64, scalar: bool = False) -> str:
        name = f"c{len(self.initializers)}"
        self.initializers.append(helper.make_tensor(name, kind, [] if scalar else [len(values)], values))
        return name

    def linear(self, x: str, name: str, inputs: int, outputs: int) -> str:
        return self.add(
            "Gemm", x, self.weight(f"{name}.weight", outputs, inputs), self.weight(f"{name}.bias", outputs), transB=1
        )

    def norm(self, x: str, name: str) -> str:
        weights = self.weight(f"{name}.weight", WIDTH), self.weight(f"{name}.bias", WIDTH)
        return self.add("LayerNormalization", x, *weights, axis=-1, epsilon=EPSILON)


def attention(graph: Graph, x: str, name: str, bias: str, heads: str, flat: str) -> str:
    """Multi-head attention of x (T, 768) with an additive bias (1, 12, T, T)."""

    def split(part: str, perm: list[int]) -> str:
        rows = graph.linear(x, f"{name}.attn.{part}", WIDTH, WIDTH)
        return graph.add("Transpose", graph.add("Reshape", rows, heads), perm=perm)

    scale = graph.constant((WIDTH // HEADS) ** -0.5, kind=TensorProto.FLOAT, scalar=True)
    query, key, value = split("q", [0, 2, 1, 3]), split("k", [0, 2, 3, 1]), split("v", [0, 2, 1, 3])
    scores = graph.add("Add", graph.add("Mul", graph.add("MatMul", query, key), scale), bias)
    mixed = graph.add("MatMul", graph.add("Softmax", scores, axis=-1), value)
    rows = graph.add("Reshape", graph.add("Transpose", mixed, perm=[0, 2, 1, 3]), flat)
    return graph.norm(graph.add("Add", x, graph.linear(rows, f"{name}.attn.o", WIDTH, WIDTH)), f"{name}.LayerNorm")


def feed_forward(graph: Graph, x: str, name: str) -> str:
    """Two linear layers with the exact (erf) GELU between them."""
    inner = graph.linear(x, f"{name}.intermediate.dense", WIDTH, INNER)
    half, one, root = (graph.constant(v, kind=TensorProto.FLOAT, scalar=True) for v in (0.5, 1.0, 2**0.5))
    gate = graph.add("Add", graph.add("Erf", graph.add("Div", inner, root)), one)
    active = graph.add("Mul", graph.add("Mul", inner, gate), half)
    return graph.norm(
        graph.add("Add", x, graph.linear(active, f"{name}.output.dense", INNER, WIDTH)), f"{name}.output.LayerNorm"
    )


def position_bias(graph: Graph) -> str:
    """Relative position bias by bucket (1, 12, T, T)."""
    table = graph.weight("encoder.relative_attention_bias.weight", BUCKETS, HEADS)
    bias = graph.add("Transpose", graph.add("Gather", table, "buckets"), perm=[2, 0, 1])
    return graph.add("Unsqueeze", bias, graph.constant(0))


def pool(graph: Graph, tokens: str) -> None:
    """Mean over the tokens, then unit length: the output `embedding` (768,)."""
    mean = graph.add("ReduceMean", tokens, axes=[0], keepdims=0)
    graph.nodes.append(helper.make_node("Div", [mean, graph.add("ReduceL2", mean, axes=[0])], ["embedding"]))


def build() -> ModelProto:
    """The whole network for one text: token ids (T,), positions (T,) and buckets (T, T) to its embedding (768,)."""
    graph = Graph()
    words = graph.add("Gather", graph.weight("embeddings.word_embeddings.weight", VOCABULARY, WIDTH), "ids")
    places = graph.weight("embeddings.position_embeddings.weight", POSITIONS, WIDTH)
    x = graph.norm(graph.add("Add", words, graph.add("Gather", places, "positions")), "embeddings.LayerNorm")
    heads, flat = graph.constant(1, -1, HEADS, WIDTH // HEADS), graph.constant(-1, WIDTH)
    bias = position_bias(graph)
    for layer in range(LAYERS):
        name = f"encoder.layer.{layer}"
        x = feed_forward(graph, attention(graph, x, f"{name}.attention", bias, heads, flat), name)
    pool(graph, x)
    int64, float32 = TensorProto.INT64, TensorProto.FLOAT
    inputs = [helper.make_tensor_value_info(name, int64, ["T"]) for name in ("ids", "positions")]
    inputs.append(helper.make_tensor_value_info("buckets", int64, ["T", "T"]))
    outputs = [helper.make_tensor_value_info("embedding", float32, [WIDTH])]
    body = helper.make_graph(graph.nodes, "all-mpnet-base-v2", inputs, outputs, graph.initializers)
    return helper.make_model(body, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    default = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data" / "mpnet.onnx"
    parser.add_argument("--output", type=Path, default=default)
    parser.parse_args().output.write_bytes(build().SerializeToString(deterministic=True))


if __name__ == "__main__":
    main()
