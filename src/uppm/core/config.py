"""Every setting, nested, with its default; `Config.load` merges a preset or a file and `key.path=value` overrides."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from uppm.core.errors import ConfigError
from uppm.core.profiles import of_profile

PRESETS = ("uppm", "paper", "panmap")
"""Configurations that ship, by name: the defaults, the paper's, and the rules of Panoptic Multi-TSDFs."""


class Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class InputConfig(Section):
    """How a sequence is read."""

    format: str | None = None
    """Reader's name; None: found by looking."""
    depth_scale: float | None = Field(default=None, gt=0)
    """Depth image units a metre; None: the format's own."""
    invert_poses: bool = False
    """The pose files hold camera-from-world transforms."""
    pose_axes: Literal["opencv", "opengl"] = "opencv"
    """Camera axes of the pose files; opengl: y up, z backward."""
    quaternion_order: Literal["xyzw", "wxyz"] = "xyzw"
    """Order in text files that hold quaternions."""
    time_tolerance: float = Field(default=0.02, ge=0)
    """Seconds between a colour image and the depth image and pose that belong to it, in formats with time stamps."""
    color_topic: str | None = None
    """Of a bag's colour images; None: found by type and name."""
    depth_topic: str | None = None
    """Of a bag's depth images; None: found by type and name."""
    color_info_topic: str | None = None
    """Of the colour camera's camera_info; None: beside the images' topic."""
    depth_info_topic: str | None = None
    """Of the depth camera's camera_info; None: beside the images' topic."""
    pose_topic: str | None = None
    """Of a bag's poses (PoseStamped, Odometry and the like); None: from /tf."""
    pose_frame: str | None = None
    """Frame whose poses `pose_topic` tells; None: the one that its messages name, else the colour camera's."""
    map_frame: str | None = None
    """Fixed frame that /tf is asked for; None: map, world or odom, whichever is above the camera."""
    stride: int = Field(default=1, ge=1)
    """Every n-th frame is used."""
    max_frames: int | None = Field(default=None, ge=1)
    depth_noise: Literal["none", "structured-light"] = "none"
    """Noise of a sensor that is put on exact depth."""
    noise_seed: int = Field(default=0, ge=0)
    strict: bool = False
    """A bad frame ends the run instead of being skipped and counted."""


class SimulatedConfig(Section):
    """Noise of the profile `simulated` (docs/simulated.md); rates are probabilities at `level` 1."""

    seed: int = Field(default=0, ge=0)
    level: float = Field(default=1.0, ge=0)
    """Multiplies every rate and every length; 0: ground truth."""
    hold: int = Field(default=3, ge=1)
    """Frames for which a name, a miss, a split or a merge stays."""
    synonym: float = Field(default=0.6, ge=0, le=1)
    """An object is called by another of its names than that of `labels.csv`."""
    wrong: float = Field(default=0.15, ge=0, le=1)
    """It is called by what it may be taken for, of another category."""
    unmentioned: float = Field(default=0.2, ge=0, le=1)
    """The caption leaves it out."""
    untagged: float = Field(default=0.4, ge=0, le=1)
    """No tag is for it; only with `use_tags`."""
    false_tags: float = Field(default=0.5, ge=0)
    """Expected tags a frame for what is not there; only with `use_tags`."""
    missed: float = Field(default=0.1, ge=0, le=1)
    """The detector gives no box; twice as often below 32x32 pixels."""
    split: float = Field(default=0.05, ge=0, le=1)
    """A thing's mask is two segments."""
    merged: float = Field(default=0.05, ge=0, le=1)
    """A thing's mask holds that of its neighbour, which has none of its own."""
    duplicated: float = Field(default=0.25, ge=0, le=1)
    """A thing has a second box, under another name."""
    part: float = Field(default=0.1, ge=0, le=1)
    """A thing has a smaller box inside its own, under the same name."""
    mask_pixels: float = Field(default=3.0, ge=0)
    """Masks are eroded or dilated by up to so many pixels, at a width of 640."""
    box_jitter: float = Field(default=0.02, ge=0)
    """Standard deviation of a box's sides, as a share of its size."""
    blurred: float = Field(default=0.05, ge=0, le=1)
    """A frame is blurred."""
    unflagged: float = Field(default=0.3, ge=0, le=1)
    """The caption of a blurred frame does not say so."""
    blur_pixels: float = Field(default=12.0, ge=0)
    """Length of the motion blur, at a width of 640."""


class PerceptionConfig(Section):
    """Front end."""

    profile: str = "embedded"
    """Name in `uppm.perception.registry`."""
    precomputed: Path | None = None
    """Folder of id images for the profile `precomputed`."""
    up: Literal["auto", "+x", "-x", "+y", "-y", "+z", "-z"] = "auto"
    """The map's up axis; auto: from the dominant floor."""
    captioner: str = of_profile("captioner", "none")
    """Name in `uppm.perception.registry`, or `none`: the segmenter brings its own vocabulary."""
    captioner_model: str | None = of_profile("captioner_model", None)
    """Name in `uppm models list`; None: the back end's first there."""
    use_tags: bool = True
    """A captioner's tags become labels too."""
    use_captions: bool = True
    """A captioner that also gives tags writes a sentence, too; otherwise its tags alone are asked for, faster."""
    skip_blurry: bool = True
    """A frame that its caption calls blurry is skipped, and so is one below `min_sharpness`."""
    min_sharpness: float = Field(default=0.0, ge=0)
    """Share of the sequence's median sharpness below which a frame is blurred; 0: none is."""
    keyframe: Literal["every", "motion"] = "every"
    """Frames that perception looks at: all, or those that motion or novelty calls for; the map labels the others."""
    keyframe_translation: float = Field(default=0.3, ge=0)
    """Metres from the last keyframe from which a frame is one."""
    keyframe_rotation: float = Field(default=15.0, ge=0)
    """Degrees from the last keyframe from which a frame is one."""
    keyframe_novelty: float = Field(default=0.2, ge=0, le=1)
    """Share of measured points that the last keyframe did not see from which a frame is one."""
    ahead: bool = False
    """Perception of the next frame runs while this one is fused; the map is the same."""
    caption_beams: int = Field(default=3, ge=1)
    """Of the search for the best caption; 1: greedy."""
    tag_list: Path | None = None
    """Tags of one's own for ram_plus, with their descriptions, and for vocabulary; None: their own lists."""
    detector: str = of_profile("detector", "nanodet")
    """Name in `uppm.perception.registry`."""
    detector_model: str | None = of_profile("detector_model", None)
    """Name in `uppm models list`; None: the back end's first there."""
    masks: str = of_profile("masks", "geometric")
    """Name in `uppm.perception.registry`."""
    masks_model: str | None = of_profile("masks_model", None)
    """Name in `uppm models list`; None: the back end's first there."""
    masks_side: Annotated[int, Field(ge=32, multiple_of=32)] | None = of_profile("masks_side", None)
    """Pixels a side to which sam2 resizes the image; None: its own 1024."""
    segmenter_model: str | None = of_profile("segmenter_model", None)
    """Of profiles that are one network, name in `uppm models list`; None: the profile's first there."""
    visual_feature: str = "none"
    """Name in `uppm.perception.registry`, or `none`: what the look of each segment is kept as, beside its labels."""
    visual_feature_model: str | None = None
    """Name in `uppm models list`; None: the first of `visual_feature` there."""
    device: str = Field(default="auto", pattern=r"^(auto|cpu|cuda(:\d+)?)$")
    """Of the torch back ends: auto, cpu, cuda or cuda:N; auto: cuda where there is one."""
    precision: Literal["auto", "float32", "float16", "bfloat16"] = "auto"
    """Of the torch back ends; auto: float16 on cuda, else float32."""
    compile: bool = False
    """`torch.compile` the torch back ends: a minute or more at the first frame; made for a GPU."""
    detector_score: float | None = Field(default=None, ge=0, le=1)
    """Least score of a detection; None: the detector's own (nanodet 0.4, grounding_dino 0.35, owlvit 0.1 ...)."""
    text_score: float = Field(default=0.25, ge=0, le=1)
    """Least score of a phrase's head noun, of detectors that score tokens (grounding_dino)."""
    prompts: Literal["separate", "joint"] = of_profile("prompts", "separate")
    """Each label in a text of its own, so that no label's boxes depend on the others, or many in one text, faster."""
    detector_nms_iou: float = Field(default=0.6, ge=0, le=1)
    nms: Literal["custom", "classic", "none"] = "custom"
    """Suppression of prompted detectors' boxes: the paper's, per class by IoU, or none."""
    nms_iou: float = Field(default=0.5, ge=0, le=1)
    """Of `nms: classic`."""
    depth_edges: Literal["auto", "cut", "keep"] = "auto"
    """Whether a mask that leaks over a depth step is cut at it; auto: unless masks come from depth (`geometric`)."""
    min_mask_pixels: int = Field(default=150, ge=1)
    """At 640x480; scales with the image's area."""
    threads: int = Field(default=2, ge=1)
    simulated: SimulatedConfig = SimulatedConfig()


class RetrievalConfig(Section):
    """Semantic retrieval (paper section 3.2.2)."""

    method: Literal["paper", "uppm", "labels"] = "uppm"
    """paper: nearest name (equation 1); uppm: prototypes; labels: each a category of its own (PPM, section 4.6)."""


class FusionConfig(Section):
    """Unified panoptic fusion (paper section 3.3, method.md section 4)."""

    depth_min: float = Field(default=0.1, ge=0)
    """Metres."""
    depth_max: float = Field(default=5.0, gt=0)
    """Metres."""
    truncation: float = Field(default=2.0, ge=1)
    """Voxels."""
    distance: Literal["normal", "ray"] = "normal"
    """Signed distance along the surface's normal, or along the ray as Panoptic Multi-TSDFs has it."""
    noise: Literal["quadratic", "linear", "constant"] = "quadratic"
    """How the depth's standard deviation grows with depth: a measurement's weight is its inverse square."""
    max_weight: float = Field(default=1e4, gt=0)
    interpolation: Literal["bilinear", "nearest"] = "bilinear"
    """Of range between pixels."""
    interpolation_max_step: float = Field(default=0.2, gt=0)
    """Metres; where the four neighbours differ by more, the nearest pixel is used."""
    belonging: Literal["majority", "once"] = "majority"
    """Whose surface a voxel holds: as often seen as the submap's as another's, or seen so once."""
    update: Literal["surface", "view", "tracked"] = "surface"
    """Blocks that a frame updates: where it can change a surface, all in view, or all of submaps with a segment."""
    voxel_size: float | None = Field(default=None, gt=0)
    """One size for every submap, metres; None: the category's size prior."""
    freespace_voxel_size: float = Field(default=0.3, gt=0)
    """Metres."""
    unlabeled_voxel_size: float = Field(default=0.05, gt=0)
    """Metres; of the background submap that holds what no segment covers."""
    min_iou: float = Field(default=0.1, ge=0, le=1)
    """Least IoU of an association (paper equation 4)."""
    association: Literal["optimal", "greedy"] = "optimal"
    """One segment to one submap with the greatest total IoU, or each segment to its best."""
    track_inactive: bool = True
    """Inactive submaps are looked for again; otherwise an object that comes back is a new submap."""
    category_policy: Literal["same", "compatible", "any"] = "compatible"
    min_cosine: float = Field(default=0.5, ge=-1, lt=1)
    """Two categories are compatible where their embeddings agree at least so much."""
    certain_iou: float = Field(default=0.5, ge=0, le=1)
    """With `compatible`: IoU, if over `min_iou`, from which a segment joins a submap whatever the two are called."""
    min_containment: float | None = Field(default=0.6, ge=0, le=1)
    """Share of a segment on one submap's surface at which it joins it though its IoU is low; None: never."""
    min_area: float = Field(default=8.0, ge=0)
    """Area in voxel faces that a segment must cover to found a submap."""
    min_pixels: int = Field(default=0, ge=0)
    """Pixels that it must have besides, at 640x480; scales with the image's area."""
    votes: Literal["weighted", "count", "first"] = "weighted"
    """Votes for the category: by score and distance, one an observation, or the first label's alone."""
    life_cycle: Literal["evidence", "count"] = "evidence"
    """Submaps are confirmed and removed by evidence in views, or by counting frames."""
    confirm_frames: int = Field(default=5, ge=1)
    """With `count`: frames right after its first in each of which a submap must be seen, or is deleted."""
    confirm_evidence: float = Field(default=1.0, ge=0)
    """Sum of detection scores at which a tentative submap is confirmed, and which it must still have at the end."""
    min_expected: int = Field(default=20, ge=1)
    """Surface voxels that must be in view for a frame to count as a miss."""
    max_misses: int = Field(default=5, ge=1)
    """Misses in view after which a tentative submap is removed and a confirmed one becomes inactive."""
    miss_penalty: float = Field(default=0.05, ge=0)
    """Evidence that an object in view loses by a frame without a segment of it."""
    resample: bool = True
    """A submap's voxels follow its category's size prior."""
    resample_confidence: float = Field(default=0.6, ge=0, le=1)
    """Confidence of a category at which its size prior is taken over."""
    resample_views: int = Field(default=4, ge=1)
    """Views before a submap is resampled for the first time."""
    merge_deactivated: Literal["all", "inactive", "none"] = "all"
    """Submaps that one is compared with when it becomes inactive, to be merged with its duplicates."""
    merge_by: Literal["overlap", "agreement"] = "overlap"
    """Duplicates: by the share of surface and by boxes, or by points that agree and none that conflict."""
    merge_overlap: float = Field(default=0.5, ge=0, le=1)
    """Share of one submap's surface that lies beside another's at which the two are merged."""
    merge_frames: int | None = Field(default=3, ge=1)
    """Frames in which one segment covers two submaps after which the two are merged; None: never."""
    split_frames: int | None = Field(default=10, ge=1)
    """Frames in which two segments fall on separate parts of a submap after which it is split; None: never."""
    clean: bool = True
    """At the end objects lose their stray parts, and all submaps what a few masks leaked onto."""
    min_surface: int = Field(default=6, ge=1)
    """Surface voxels that a submap must hold at the end."""
    max_blocks: int = Field(default=2_000_000, ge=1024)
    """Address space of the block pool; memory is taken as blocks are used (5.6 kB each)."""
    threads: int = Field(default=2, ge=1)


class MapConfig(Section):
    checkpoint_every: int = Field(default=20, ge=1)
    """Frames between transactions of the map file."""


class Config(Section):
    """The whole configuration; stored in the map."""

    input: InputConfig = InputConfig()
    perception: PerceptionConfig = PerceptionConfig()
    retrieval: RetrievalConfig = RetrievalConfig()
    fusion: FusionConfig = FusionConfig()
    map: MapConfig = MapConfig()

    @classmethod
    def load(cls, source: Path | str | None = None, overrides: Sequence[str] = ()) -> Config:
        """Defaults, then a preset or a YAML file, then overrides of the form `fusion.truncation=3`.

        Parameters
        ----------
        source : str, Path or None
            Name of one of `PRESETS`, or a file; `Path("paper")` and "./paper" are files. A file may build on a preset
            with `base: paper`.
        overrides : sequence of str

        Raises
        ------
        ConfigError
            A key is unknown or a value does not fit; the message names it.
        """
        data = _settings(source) if source else {}
        source = str(source) if source else "configuration"
        for override in overrides:
            _apply(data, override)
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            found = f"{first['input']!r} ({first['msg'].lower()})"
            advice = "see docs/configuration.md for the settings"
            if first["type"] == "extra_forbidden":
                raise ConfigError(source, expected="a setting", found=repr(where), advice=advice) from None
            raise ConfigError(source, expected=f"a valid {where!r}", found=found, advice=advice) from None


def _settings(source: Path | str) -> dict[str, Any]:
    """What a file says, over the preset that it builds on."""
    data = _read_yaml(source)
    base = data.pop("base", None)
    if base is None:
        return data
    if base not in PRESETS:
        expected = f"one of {', '.join(PRESETS)} as `base`"
        raise ConfigError(source, expected=expected, found=repr(base), advice="name one, or drop `base`")
    return _merged(_settings(base), data)


def _merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Settings of both, section by section; the latter win."""
    both = dict(base)
    for key, value in over.items():
        inner: Any = both.get(key)
        both[key] = _merged(inner, value) if isinstance(inner, dict) and isinstance(value, dict) else value  # pyright: ignore[reportUnknownArgumentType]
    return both


def _read_yaml(source: Path | str) -> dict[str, Any]:
    preset = source in PRESETS
    file = resources.files("uppm.data").joinpath("presets", f"{source}.yaml") if preset else Path(source)
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        found, advice = str(error).replace("\n", " "), f"correct or drop --config, or name one of {', '.join(PRESETS)}"
        raise ConfigError(source, expected="a YAML file", found=found, advice=advice) from None
    if data is None:
        return {}
    if not isinstance(data, dict):
        advice = "write sections such as `fusion:`"
        raise ConfigError(source, expected="a YAML mapping", found=type(data).__name__, advice=advice)
    return data  # pyright: ignore[reportUnknownVariableType]


def _apply(data: dict[str, Any], override: str) -> None:
    path, equals, text = override.partition("=")
    *sections, name = path.strip().split(".")
    value, readable = None, bool(equals and name)
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        readable = False
    if not readable:
        expected = "section.name=value, the value as in YAML"
        raise ConfigError("--set", expected=expected, found=repr(override), advice="write it so")
    for section in sections:
        inner = data.setdefault(section, {})
        if not isinstance(inner, dict):
            found, advice = f"{inner!r} for {section!r}, which is a section", "give it settings, not a value"
            raise ConfigError("configuration", expected="section.name=value", found=found, advice=advice)
        data = inner  # pyright: ignore[reportUnknownVariableType]
    data[name] = value
