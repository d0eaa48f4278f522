"""Text embeddings that are computed once: shipped with the package, kept in the map, or made now."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from threading import Lock

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name, unified_categories
from uppm.core.protocols import TextEncoder
from uppm.perception.retrieval.prototypes import prototypes
from uppm.perception.simulated.names import all_labels

Vector = npt.NDArray[np.float32]


class LabelEmbeddings:
    """E with a memory; a `TextEncoder`. A text is looked up among the map's, then in the shipped table, then encoded.

    Parameters
    ----------
    encoder : TextEncoder, optional
        Asked for unknown texts only; None: the MPNet encoder, which is loaded when the first unknown text comes.
    known : mapping, optional
        Text -> unit vector (768,) that the map already holds.
    """

    def __init__(self, encoder: TextEncoder | None = None, known: Mapping[str, Vector] | None = None) -> None:
        self._encoder, self._lock = encoder, Lock()
        self._vectors: dict[str, Vector] = dict(known or {})
        self._new: dict[str, Vector] = {}

    def encode(self, texts: Sequence[str]) -> npt.NDArray[np.float32]:
        """Unit vectors (N, 768).

        Raises
        ------
        UppmError
            A text is unknown and the encoder's weights cannot be found.
        """
        with self._lock:  # perception may run in a thread of its own
            self._find([text for text in dict.fromkeys(texts) if text not in self._vectors])
        return np.stack([self._vectors[text] for text in texts]) if texts else np.empty((0, 768), np.float32)

    def _find(self, asked: Sequence[str]) -> None:
        found = {text: shipped_embeddings()[text] for text in asked if text in shipped_embeddings()}
        missing = [text for text in asked if text not in found]
        if missing:
            found.update(zip(missing, self._load().encode(missing), strict=True))
        self._vectors.update(found)
        self._new.update(found)

    def take_new(self) -> dict[str, Vector]:
        """Text -> vector of what was first asked for since the last call, for `Checkpoint.label_embeddings`."""
        new, self._new = self._new, {}
        return new

    def _load(self) -> TextEncoder:
        if self._encoder is None:
            from uppm.perception.retrieval.mpnet import MpnetEncoder

            self._encoder = MpnetEncoder()
        return self._encoder


def shipped_texts() -> list[str]:
    """What the shipped table must hold: category names, as they are and as said, terms, glosses, simulated labels."""
    names = [category.name for category in unified_categories()]
    texts = [*names, *map(plain_name, names)]
    for row in prototypes():
        texts += [*row.terms, row.gloss, *row.wordnet_terms, *row.wordnet_glosses]
    return list(dict.fromkeys([*texts, *all_labels()]))


@cache
def shipped_embeddings() -> Mapping[str, Vector]:
    """Text -> unit vector (768,) of the table that ships; stored in half precision, normalised again here."""
    data = resources.files("uppm.data").joinpath("embeddings.npz").read_bytes()
    with np.load(io.BytesIO(data)) as table:
        texts = bytes(table["texts"]).decode("utf-8").split("\n")
        vectors = table["vectors"].astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return dict(zip(texts, vectors, strict=True))


def write_table(file: Path, texts: Sequence[str], vectors: npt.NDArray[np.float32]) -> None:
    """Write a table for `shipped_embeddings`; the same input gives the same bytes."""
    encoded = np.frombuffer("\n".join(texts).encode("utf-8"), dtype=np.uint8)
    np.savez(file, texts=encoded, vectors=vectors.astype(np.float16))
