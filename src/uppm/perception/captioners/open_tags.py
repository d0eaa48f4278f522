"""Tags of one's own for RAM++: descriptions of each, embedded by CLIP ViT-B/16's text tower."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from uppm.perception.models.network import Weights
from uppm.perception.models.store import model_folder

CLIP = "clip-vit-base-patch16"
OPEN_THRESHOLD = 0.5
"""Least probability of tags that the network was not trained on, as published."""


def embed_descriptions(descriptions: Sequence[Sequence[str]]) -> npt.NDArray[np.float32]:
    """(K, D, 512): unit vectors of K tags' D descriptions. Run once, on the CPU."""
    from transformers import CLIPTextModelWithProjection, CLIPTokenizerFast  # pyright: ignore[reportAttributeAccessIssue]

    weights = Weights(name=CLIP, folder=model_folder(CLIP))
    with weights.reading():
        encoder: Any = weights.pretrained(CLIPTextModelWithProjection).eval()
        tokenizer = CLIPTokenizerFast.from_pretrained(weights.folder, local_files_only=True)
    rows: list[npt.NDArray[np.float32]] = []
    with torch.inference_mode():
        for texts in descriptions:
            tokens = tokenizer(list(texts), padding=True, truncation=True, return_tensors="pt")
            vectors = encoder(**tokens).text_embeds
            rows.append((vectors / vectors.norm(dim=-1, keepdim=True)).float().numpy())
    return np.stack(rows)
