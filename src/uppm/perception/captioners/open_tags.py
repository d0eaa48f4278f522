"""Tags of one's own for RAM++: descriptions of each, embedded by CLIP ViT-B/16's text tower."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from uppm.core.errors import InputError
from uppm.perception.models.network import Weights
from uppm.perception.models.store import model_folder

CLIP = "clip-vit-base-patch16"
OPEN_THRESHOLD = 0.5
"""Least probability of tags that the network was not trained on, as published."""
ADVICE = "see docs/models.md for the two forms"


def read_descriptions(file: Path) -> dict[str, list[str]]:
    """Tag -> its descriptions, as many for each tag.

    Either a text file, one tag a line, each described as `a photo of a TAG.`; or JSON as RAM++'s authors publish it, a
    list of objects with one tag each and the list of its descriptions.

    Raises
    ------
    InputError
        The file cannot be read, or is of neither form.
    """
    try:
        text = file.read_text(encoding="utf-8")
        if file.suffix != ".json":
            return {tag: [f"a photo of a {tag}."] for tag in (line.strip() for line in text.splitlines()) if tag}
        found = {tag: list(texts) for entry in json.loads(text) for tag, texts in entry.items()}
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise InputError(file, expected="a list of tags", found=str(error), advice=ADVICE) from None
    if len({len(texts) for texts in found.values()}) != 1 or not all(
        isinstance(t, str) for d in found.values() for t in d
    ):
        expected = "as many descriptions, all of them texts, for each tag"
        raise InputError(file, expected=expected, found="another number for some", advice=ADVICE)
    return found


def embed_descriptions(descriptions: Sequence[Sequence[str]]) -> npt.NDArray[np.float32]:
    """(K, D, 512): unit vectors of K tags' D descriptions. Run once, on the CPU."""
    from transformers import CLIPTextModelWithProjection, CLIPTokenizerFast  # pyright: ignore[reportAttributeAccessIssue]

    weights = Weights(name=CLIP, folder=model_folder(CLIP))
    encoder: Any = weights.pretrained(CLIPTextModelWithProjection).eval()
    tokenizer = CLIPTokenizerFast.from_pretrained(weights.folder, local_files_only=True)
    rows: list[npt.NDArray[np.float32]] = []
    with torch.inference_mode():
        for texts in descriptions:
            tokens = tokenizer(list(texts), padding=True, truncation=True, return_tensors="pt")
            vectors = encoder(**tokens).text_embeds
            rows.append((vectors / vectors.norm(dim=-1, keepdim=True)).float().numpy())
    return np.stack(rows)
