"""What a vision-language model writes of a frame: a caption of the objects that it mentions, and tags."""

from __future__ import annotations

from collections.abc import Sequence

from uppm.core.config import PerceptionConfig
from uppm.core.language import Caption
from uppm.core.types import Frame
from uppm.perception.simulated.noise import frame_noise
from uppm.perception.simulated.truth import ground_truth

WITHOUT_ARTICLE = ("bread", "fruit", "flowers", "tulips", "headphones", "earphones", "luggage")


class SimulatedCaptioner:
    """A `Captioner` that has been told what is in the frame, and passes on some of it."""

    def __init__(self, config: PerceptionConfig) -> None:
        self._config = config.simulated

    def caption(self, frame: Frame) -> Caption:
        """Caption and tags of one frame; raises `InputError` where the sequence has no ground truth."""
        noise = frame_noise(frame, ground_truth(frame), self._config)
        mentioned = [i.name for i in noise.instances if i.in_caption]
        mentioned += [i.other_name for i in noise.instances if i.in_caption and i.duplicated]
        tags = [i.tag for i in noise.instances if i.in_tags] + [tag.name for tag in noise.false_tags]
        return Caption(text=sentence(mentioned, blurry=noise.flagged), tags=tuple(dict.fromkeys(tags)))


def sentence(names: Sequence[str], *, blurry: bool = False) -> str:
    """'a photo of a sofa, a coffee table and a rug'; each name once, in the order given."""
    phrases = [_with_article(name) for name in dict.fromkeys(names)]
    listed = " and ".join(filter(None, [", ".join(phrases[:-1]), *phrases[-1:]])) or "nothing"
    return f"a blurry photo of {listed}" if blurry else f"a photo of {listed}"


def _with_article(name: str) -> str:
    if name in WITHOUT_ARTICLE:
        return name
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"
