"""`uppm models`: which networks there are, where their files lie, and whether they are what they were."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

models_app = typer.Typer(help="Weights on disk (docs/models.md).", no_args_is_help=True)
Names = Annotated[list[str] | None, typer.Argument(help="As `uppm models list` shows them.")]
Offline = Annotated[bool, typer.Option("--offline", help="Try no network, as UPPM_OFFLINE=1 does.")]


@models_app.callback()
def models() -> None:
    """Weights on disk (docs/models.md)."""


@models_app.command("list")
def list_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print a list of objects.")] = False,
) -> None:
    """Every model: back end, licence, size, where it comes from and where it lies; tries no network."""
    from uppm.perception.models.table import MODELS

    rows = [_row(name) for name in MODELS]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for title in ("name", "back end", "licence", "MB", "hub repository", "here"):
        table.add_column(title, overflow="fold", no_wrap=title == "name")
    for row in rows:
        table.add_row(*(str(row[key]) for key in ("name", "back_end", "licence", "megabytes", "repo", "state")))
    Console().print(table)


@models_app.command("download")
def download_command(
    names: Names = None,
    profile: Annotated[str | None, typer.Option(help="Fetch what a perception profile needs.")] = None,
    offline: Offline = False,
) -> None:
    """Fetch models from the Hugging Face hub, pin them, and hold them to their sums; goes on after a break."""
    from uppm.core.errors import InputError
    from uppm.perception.models import store
    from uppm.perception.models.table import with_needs
    from uppm.perception.provision import absent_models

    _go_offline(offline)
    if not names and not profile:
        advice = "see `uppm models list`"
        raise InputError("models download", expected="a model or --profile", found="none", advice=advice)
    wanted = with_needs([*(names or []), *(_of_profile(profile) if profile else [])])
    if not wanted:
        typer.echo(f"{profile}: needs no model")
    absent_models(wanted)
    for name in wanted:
        typer.echo(f"{name}: {store.find(name) or store.fetch(name)}")


@models_app.command("verify")
def verify_command(
    names: Names = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a list of objects.")] = False,
) -> None:
    """Read every byte of the models on this machine again; exit code 1 names each file that is not what it was."""
    from uppm.core.errors import InputError
    from uppm.perception.models import store
    from uppm.perception.models.table import MODELS, with_needs

    rows: list[dict[str, Any]] = []
    for name in with_needs(names) if names else MODELS:
        try:
            folder = store.find(name, again=True)
            if folder is None and names:
                raise store.missing(name, ["not in UPPM_MODELS or the hub's cache"])
            if folder is not None:
                rows.append({"name": name, "ok": True, "folder": str(folder), "error": None})
        except InputError as error:
            rows.append({"name": name, "ok": False, "folder": str(Path(error.source).parent), "error": str(error)})
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
    else:
        for row in rows:
            typer.echo(f"{row['name']}: {'ok, ' + row['folder'] if row['ok'] else row['error']}")
        if not rows:
            typer.echo("no model of `uppm models list` is on this machine")
    if not all(row["ok"] for row in rows):
        raise typer.Exit(1)


@models_app.command("path")
def path_command(name: Annotated[str, typer.Argument(help="As `uppm models list` shows it.")]) -> None:
    """Print the folder of one model, verified; tries no network."""
    from uppm.perception.models import store

    tried: list[str] = []
    folder = store.find(name, tried.append)
    if folder is None:
        raise store.missing(name, tried)
    typer.echo(folder)


def _of_profile(profile: str) -> list[str]:
    """What a profile needs with its default settings."""
    from uppm.core.config import PerceptionConfig
    from uppm.perception.provision import needed_models
    from uppm.perception.registry import check_profile

    check_profile(profile)
    return needed_models(PerceptionConfig(profile=profile))


def _go_offline(wanted: bool) -> None:
    import os

    if wanted:
        os.environ["UPPM_OFFLINE"] = "1"


def _row(name: str) -> dict[str, Any]:
    from uppm.core.errors import InputError
    from uppm.perception.models import store
    from uppm.perception.models.files import read_lock
    from uppm.perception.models.table import model_spec

    spec, folder, revision, state = model_spec(name), None, None, "no"
    try:
        folder = store.find(name)
        lock = read_lock(store.lock_home(spec, folder)) if folder else None
        revision, state = lock.revision if lock else None, "yes" if folder else "no"
    except InputError:
        state = "corrupt: see `uppm models verify`"
    return {
        "name": name,
        "back_end": spec.back_end,
        "licence": spec.licence,
        "megabytes": spec.megabytes,
        "repo": spec.repo,
        "revision": spec.revision or revision,
        "sha256": dict(spec.sha256),
        "state": state,
        "folder": str(folder) if folder else None,
    }
