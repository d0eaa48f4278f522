"""The encoder against sentence-transformers: its stored vectors, and itself where it is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uppm.core.errors import InputError
from uppm.perception.retrieval import mpnet
from uppm.perception.retrieval.weights import model_folder

GOLDEN = Path(__file__).parent / "data" / "mpnet_golden.npz"
"""By sentence-transformers 6.2.0, torch 2.13.0, transformers 5.23.0 on the official files."""


def test_agrees_with_golden_vectors(encoder: mpnet.MpnetEncoder) -> None:
    with np.load(GOLDEN) as golden:
        texts, expected = [str(text) for text in golden["texts"]], golden["vectors"]
    found = encoder.encode(texts)
    assert found.dtype == np.float32
    assert (found * expected).sum(axis=1).min() >= 0.99999
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-5


def test_agrees_with_sentence_transformers(encoder: mpnet.MpnetEncoder) -> None:
    reference = pytest.importorskip("sentence_transformers", exc_type=ImportError)
    texts = ["a very small blue mug", "wall-other", "tv", "THE Couch by the window!", ""]
    model = reference.SentenceTransformer(str(model_folder()), device="cpu")
    expected = model.encode(texts, normalize_embeddings=True)
    assert (encoder.encode(texts) * expected).sum(axis=1).min() >= 0.99999


def test_a_text_does_not_depend_on_its_neighbours(encoder: mpnet.MpnetEncoder) -> None:
    alone = encoder.encode(["cup"])
    among = encoder.encode(["a long sentence about a kitchen with many things in it", "cup", "chair"])
    assert np.array_equal(alone[0], among[1])
    assert encoder.encode([]).shape == (0, mpnet.DIMENSION)


def test_relative_buckets_as_the_original_computes_them() -> None:
    def original(distance: int) -> int:
        offset, n = (16, -distance) if distance < 0 else (0, distance)
        if n < 8:
            return offset + n
        return offset + min(8 + int(np.log(np.float32(n / 8)) / np.log(16) * 8), 15)

    buckets = mpnet.relative_buckets(384)
    expected = [[original(query - key) for key in range(384)] for query in (0, 10, 200, 383)]
    assert np.array_equal(buckets[[0, 10, 200, 383]], expected)


@pytest.mark.parametrize("content", [b"", b"\x10\0\0\0\0\0\0\0{}", b"\xff" * 64, b"\x04\0\0\0\0\0\0\0nope"])
def test_a_broken_safetensors_file_is_named(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "model.safetensors"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"model\.safetensors: expected a safetensors file"):
        mpnet.read_safetensors(file)
