"""`uppm evaluate retrieval`: how often a label gets a category that a person would accept."""

from __future__ import annotations

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
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write a report there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON for programs.")] = False,
) -> None:
    """Accuracy of semantic retrieval on a list of labels with accepted categories (docs/retrieval.md)."""
    from uppm.cli.evaluate_output import show
    from uppm.core.config import RetrievalConfig
    from uppm.evaluation import html, plots
    from uppm.perception.retrieval import create_retriever
    from uppm.perception.retrieval.category import PrototypeRetriever
    from uppm.perception.retrieval.embeddings import LabelEmbeddings
    from uppm.perception.retrieval.evaluation import by_supercategory, evaluate_retrieval, read_labels
    from uppm.regimes.report import Report, make_folder

    listed = read_labels(labels)
    if output:
        make_folder(output)
    if leave_one_out and retrieval == "uppm":
        retriever = PrototypeRetriever(LabelEmbeddings(), leave_out=True)
    else:
        retriever = create_retriever(RetrievalConfig(method=retrieval), LabelEmbeddings())
    result = evaluate_retrieval(listed, retriever)
    misses = [[miss.label, miss.found, " or ".join(miss.accepted)] for miss in result.misses]
    sections: list[html.Section] = []
    if output:
        plot = plots.right_and_wrong(by_supercategory(listed, result))
        caption = "Labels by the supercategory of the first category that a person would accept."
        sections = [
            html.Section(title="By supercategory", body=html.image(plot, "image/svg+xml", caption)),
            html.Section(title="Misses", body=html.table(["label", "found", "accepted"], misses, text=3)),
        ]
    title = f"Retrieval: {labels.name}"
    show(
        Report(regime="retrieval", title=title, results={retrieval: asdict(result)}, sections=sections),
        output,
        as_json=as_json,
    )
    if not as_json:
        for label, found, accepted in misses:
            typer.echo(f"  {label}: {found}, not {accepted}")
