"""Semantic retrieval: text -> embedding -> unified category and size prior (paper section 3.2.2, docs/retrieval.md)."""

from __future__ import annotations

from uppm.core.config import RetrievalConfig
from uppm.core.protocols import Retriever, TextEncoder


def create_retriever(config: RetrievalConfig, encoder: TextEncoder) -> Retriever:
    """The retriever that `config.method` names; `encoder`: usually the map's `LabelEmbeddings`."""
    from uppm.perception.retrieval.category import LabelRetriever, PaperRetriever, PrototypeRetriever

    if config.method == "labels":
        return LabelRetriever()
    return {"paper": PaperRetriever, "uppm": PrototypeRetriever}[config.method](encoder)
