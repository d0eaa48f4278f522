"""What a profile of perception sets beside itself: its back ends, and what makes them fast."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field

PROFILES: Mapping[str, Mapping[str, Any]] = {
    "foundation": {
        "captioner": "tag2text",
        "detector": "grounding_dino",
        "detector_model": "grounding-dino-tiny",
        "masks": "sam",
        "masks_model": "sam-vit-huge",
    },
    "foundation-light": {
        "captioner": "vocabulary",
        "detector": "owlvit",
        "detector_model": "owlvit-base-patch32",
        "masks": "sam2",
        "masks_model": "sam2.1-hiera-tiny",
        "masks_side": 512,
        "prompts": "joint",
    },
    "sam3": {"captioner": "tag2text"},
    "simulated": {"captioner": "simulated"},
}
"""Profile -> its defaults of other settings of `PerceptionConfig`, where they are not those of `embedded`."""
OF_BACK_END = {
    "captioner_model": "captioner",
    "detector_model": "detector",
    "masks_model": "masks",
    "masks_side": "masks",
}
"""Setting -> the back end that it is of."""


def of_profile(name: str, otherwise: Any) -> Any:
    """A default that depends on the profile, so that naming a profile names its back ends.

    What a profile says of a back end (`masks_model`, `masks_side`) is the default only where the back end is its own.
    """
    back_end = OF_BACK_END.get(name, name)

    def default(given: dict[str, Any]) -> Any:
        profile = PROFILES.get(str(given.get("profile")), {})
        own = given.get(back_end, profile.get(back_end)) == profile.get(back_end)
        return profile.get(name, otherwise) if own else otherwise

    return Field(default_factory=default)
