"""The program: one thin command a file; errors on purpose end in one line and exit code 2."""

from __future__ import annotations

import errno
import sys
from typing import Annotated

import typer

from uppm.cli.bench import bench_app
from uppm.cli.bench_ablation import bench_ablation_command
from uppm.cli.bench_query import bench_query_command
from uppm.cli.check import check
from uppm.cli.convert import convert_app
from uppm.cli.demo import demo
from uppm.cli.edit import edit
from uppm.cli.evaluate import evaluate_app
from uppm.cli.evaluate_aggregate import evaluate_aggregate_command
from uppm.cli.evaluate_query import evaluate_query_command
from uppm.cli.evaluate_retrieval import evaluate_retrieval_command
from uppm.cli.evaluate_segmentation import evaluate_segmentation_command
from uppm.cli.evaluate_sequence import evaluate_sequence_command
from uppm.cli.export import export
from uppm.cli.info import info
from uppm.cli.live import live
from uppm.cli.map import map_command
from uppm.cli.models import models_app
from uppm.cli.query import query
from uppm.cli.render import render
from uppm.cli.studies import evaluate_ablation_command, evaluate_noise_command
from uppm.cli.view import view
from uppm.core.errors import UppmError

bench_app.command("ablation")(bench_ablation_command)
bench_app.command("query")(bench_query_command)
evaluate_app.command("sequence")(evaluate_sequence_command)
evaluate_app.command("segmentation")(evaluate_segmentation_command)
evaluate_app.command("query")(evaluate_query_command)
evaluate_app.command("retrieval")(evaluate_retrieval_command)
evaluate_app.command("aggregate")(evaluate_aggregate_command)
app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=False)
app.command("map")(map_command)
app.command()(live)
app.command()(check)
app.command()(info)
app.command()(query)
app.command()(edit)
app.command()(export)
app.command()(view)
app.command()(render)
app.command()(demo)
app.add_typer(evaluate_app, name="evaluate")
app.add_typer(bench_app, name="bench")
app.add_typer(convert_app, name="convert")
app.add_typer(models_app, name="models")
evaluate_app.command("ablation")(evaluate_ablation_command)
evaluate_app.command("noise")(evaluate_noise_command)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"uppm {version('uppm')}")
        raise typer.Exit


@app.callback()
def uppm(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False,
) -> None:
    """Unified promptable panoptic mapping: posed RGB-D in, a map that knows what things are out."""


def main() -> None:
    """Entry point: what is wrong with the input or the disk is one line on standard error and exit code 2."""
    try:
        app()
    except UppmError as error:
        _end(str(error))
    except OSError as error:
        if error.filename is None and error.errno not in (errno.ENOSPC, errno.EACCES, errno.EFBIG, errno.EPIPE):
            raise
        found = error.strerror or str(error)
        where = error.filename or "a file"
        _end(f"{where}: expected a file that can be read and written, found {found}; look at its permissions")


def _end(message: str) -> None:
    # One line, whatever a library's message held that is quoted in it.
    typer.echo(f"error: {' '.join(message.split())}", err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
