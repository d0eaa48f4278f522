"""The encoder, loaded once."""

from __future__ import annotations

import pytest

from uppm.core.errors import UppmError
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.retrieval.mpnet import MpnetEncoder
from uppm.perception.retrieval.weights import model_folder


@pytest.fixture(scope="session")
def encoder() -> MpnetEncoder:
    """The real encoder; the test is skipped where its weights are not installed."""
    try:
        return MpnetEncoder(model_folder())
    except UppmError as error:
        pytest.skip(f"no weights: {error}")


@pytest.fixture(scope="session")
def embeddings(encoder: MpnetEncoder) -> LabelEmbeddings:
    """The real encoder behind the shipped table."""
    return LabelEmbeddings(encoder)
