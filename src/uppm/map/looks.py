"""How phrases look: the text side of the model that made a map's visual features."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name, unified_categories
from uppm.core.errors import UppmError
from uppm.core.protocols import TextEncoder

PROMPT = "a photo of a {}"
"""As such models were trained and are asked (Radford et al. 2021, section 3.1.4)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Looks:
    """Phrases and categories in the space of a map's visual features; nothing where there is no encoder."""

    encoder: TextEncoder | None = None
    categories: npt.NDArray[np.float32] | None = None
    """(C, E) unit vectors of the categories' names."""
    note: str = ""
    """Why a map that has visual features is asked without them."""

    @classmethod
    def made(cls, make: Callable[[], TextEncoder]) -> Looks:
        """With an encoder; without one, and with a note, where it or its weights are not on this machine."""
        try:
            encoder = make()
            prompts = [PROMPT.format(plain_name(category.name)) for category in unified_categories()]
            return cls(encoder=encoder, categories=encoder.encode(prompts))
        except UppmError as error:
            return cls(note=f"asked without how things look: {error}")

    def of(self, phrase: str) -> npt.NDArray[np.float32] | None:
        """(E,) unit vector of a phrase."""
        return self.encoder.encode([PROMPT.format(phrase)])[0] if self.encoder else None
