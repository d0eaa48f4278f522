"""`uppm evaluate retrieval`: how often a label gets a category that a person would accept."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer


def evaluate_retrieval_command(
    labels: Annotated[Path, typer.Argument(metavar="LABELS.tsv", help="Lines `label<TAB>category|category`.")],
    retrieval: Annotated[Literal["paper", "uppm"], typer.Option(help="Method to measure.")] = "uppm",
    leave_one_out: Annotated[
        bool, typer.Option("--leave-one-out", help="Judge each label without its own entry in the table (uppm only).")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Accuracy of semantic retrieval on a list of labels with accepted categories (docs/retrieval.md)."""
    from uppm.core.config import RetrievalConfig
    from uppm.perception.retrieval import create_retriever
    from uppm.perception.retrieval.category import PrototypeRetriever
    from uppm.perception.retrieval.embeddings import LabelEmbeddings
    from uppm.perception.retrieval.evaluation import evaluate_retrieval, read_labels

    if leave_one_out and retrieval == "uppm":
        retriever = PrototypeRetriever(LabelEmbeddings(), leave_out=True)
    else:
        retriever = create_retriever(RetrievalConfig(method=retrieval), LabelEmbeddings())
    result = evaluate_retrieval(read_labels(labels), retriever)
    if as_json:
        typer.echo(json.dumps({"method": retrieval, **asdict(result)}, indent=2))
        return
    typer.echo(f"{retrieval}: {100 * result.accuracy:.1f} % of {result.labels} labels right")
    for miss in result.misses:
        typer.echo(f"  {miss.label}: {miss.found}, not {' or '.join(miss.accepted)}")
