"""The one composer: frames through perception, retrieval and fusion into a panoptic map, and the map into a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from importlib.metadata import version
from math import inf
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
import numpy.typing as npt

from uppm.core.categories import unified_categories
from uppm.core.config import Config
from uppm.core.errors import BadFrameError, InputError, nothing_usable
from uppm.core.geometry import invert
from uppm.core.nulls import NoViewer, Timer
from uppm.core.parallel import exclusive, run_ahead
from uppm.core.protocols import FrameSource, FrameViewer, Labeler, Progress, Retriever, Segmenter, TextEncoder
from uppm.core.threads import within_cores
from uppm.core.types import Checkpoint, Frame, FrameRecord, Mesh, Report, Submap
from uppm.datasets.registry import open_sequence
from uppm.editing import CorrectedReader
from uppm.fusion.engine import PanopticFusion
from uppm.map.mesher import MapMesher
from uppm.map.panoptic_map import PanopticMap
from uppm.map.shown import live_content
from uppm.map.store import MapMeta, MapReader, MapWriter, check_free, saved_config
from uppm.perception.front_end import FrontEnd, Percept, good_frames, spread_frames
from uppm.perception.labels.lemma import lemmatize
from uppm.perception.labels.phrases import pos_tags
from uppm.perception.registry import create_labeler, create_look_encoder, create_segmenter, seen_by_camera
from uppm.perception.retrieval import create_retriever
from uppm.perception.retrieval.category import category_vectors
from uppm.perception.retrieval.embeddings import LabelEmbeddings
from uppm.perception.segmentation.gravity import estimate_gravity

__all__ = ["Mapper", "compare_maps", "good_frames", "map_sequence", "open_map", "open_sequence", "spread_frames"]


class Mapper:
    """Builds a unified promptable panoptic map, frame by frame.

    Any thread may call its methods; `lock` is held while the map changes, and by whoever reads voxels meanwhile.

    Parameters
    ----------
    config : Config
    labeler, segmenter, retriever, viewer : optional
        Back ends in place of those that the configuration names.

    Examples
    --------
    >>> mapper = Mapper()
    >>> for frame in frames:
    ...     mapper.integrate(frame)
    >>> mapper.map.query("mug")
    """

    def __init__(
        self,
        config: Config | None = None,
        *,
        labeler: Labeler | None = None,
        segmenter: Segmenter | None = None,
        retriever: Retriever | None = None,
        viewer: FrameViewer | None = None,
    ) -> None:
        self.config = config or Config()
        self.lock = RLock()
        self._embeddings, running = LabelEmbeddings(), within_cores(self.config)
        self.front_end = FrontEnd(
            running.perception,
            labeler or create_labeler(running.perception),
            segmenter or create_segmenter(running.perception),
            retriever or create_retriever(running.retrieval, self._embeddings),
        )
        """Perception; it never looks at the map."""
        self._viewer = viewer or NoViewer()
        self._fusion = PanopticFusion(running.fusion, category_similarity(self._embeddings))
        self._mesher = MapMesher()
        self._timer, self._restored = Timer(), Report()
        self._integrated, self._skipped, self._dropped = 0, Counter[str](), Counter[str]()
        self._records: list[FrameRecord] = []
        self._all_records: list[FrameRecord] = []
        self.provenance = {"uppm": version("uppm")}
        """Noted with the map: program version, sequence, and the map's up axis where `prepare` found it."""

    @exclusive
    def prepare(self, frames: Sequence[Frame]) -> None:
        """Let perception look at a few frames spread over the sequence (for gravity, say); optional."""
        self.front_end.prepare(frames)
        if frames:
            up = estimate_gravity(frames, self.config.perception.up).up
            self.provenance["up"] = " ".join(f"{value:.6f}" for value in up)

    def integrate(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Fuse one frame; returns the submap id of each pixel, (H, W), 0 where there is none.

        A frame that perception judges unfit (blurred, say) is counted as skipped and has no submaps.
        """
        return self.fuse(frame, self.front_end.perceive(frame))

    @exclusive
    def fuse(self, frame: Frame, percept: Percept) -> npt.NDArray[np.int32]:
        """As `integrate`, of a frame that `front_end` has looked at."""
        self._dropped.update(percept.dropped)
        self._timer.add(percept.seconds)
        if percept.skip:
            self._skip(FrameRecord(index=frame.index, stamp=frame.stamp, T_map_camera=None, skipped=percept.skip))
            return np.zeros(frame.depth.shape, dtype=np.int32)
        with self._timer("fusion"):
            segments = percept.segmentation  # UPF, equation 4
            submap_ids = self._fusion.carry(frame) if segments is None else self._fusion.fuse(frame, segments)
        self._integrated += 1
        self._record(FrameRecord(index=frame.index, stamp=frame.stamp, T_map_camera=frame.T_map_camera))
        self._viewer.show(frame, submap_ids, lambda seconds: live_content(self.map, self.meshes(seconds)))
        return submap_ids

    @exclusive
    def skip(self, index: int, reason: str) -> None:
        """Count a frame that cannot be used."""
        self._skip(FrameRecord(index=index, stamp=float("nan"), T_map_camera=None, skipped=reason))

    def _skip(self, record: FrameRecord) -> None:
        self._skipped[str(record.skipped)] += 1
        self._record(record)

    def _record(self, record: FrameRecord) -> None:
        self._records.append(record)
        self._all_records.append(record)

    @exclusive
    def update_poses(self, poses: Mapping[int, npt.NDArray[np.float64]]) -> None:
        """Take over corrected poses, after a loop closure say: submaps move, nothing is fused again.

        Parameters
        ----------
        poses : mapping
            Frame index -> corrected T_map_camera (4, 4), of frames that were integrated; others are ignored.
        """
        corrections: dict[int, npt.NDArray[np.float64]] = {}
        corrected: dict[int, FrameRecord] = {}
        for record in self._all_records:
            if record.T_map_camera is not None and record.index in poses:
                corrections[record.index] = poses[record.index] @ invert(record.T_map_camera)
                corrected[record.index] = replace(record, T_map_camera=poses[record.index])
        if not corrections:
            return
        self._fusion.move(corrections)
        self._all_records = [corrected.get(r.index, r) for r in self._all_records]
        pending = {r.index for r in self._records}
        self._records = [corrected.get(r.index, r) for r in self._records]
        self._records += [r for n, r in corrected.items() if n not in pending]

    @exclusive
    def finish(self) -> None:
        """End the session: drop unconfirmed submaps, merge duplicates."""
        with self._timer("finish"):
            self._fusion.finish()

    def close(self) -> None:
        """Release the networks that perception holds; the map stays, and another frame would load them again."""
        self.front_end.close()

    @property
    @exclusive
    def report(self) -> Report:
        """What was done and left out so far."""
        return Report(
            frames=self._restored.frames + self._integrated,
            skipped=dict(Counter(self._restored.skipped) + self._skipped),
            dropped=dict(Counter(self._restored.dropped) + self._dropped + self._fusion.dropped),
            seconds=dict(self._timer.seconds),
        )

    @property
    @exclusive
    def map(self) -> PanopticMap:
        """The map as it is now. Its voxels are the running fusion's: mesh it before the next frame, or ask again."""
        submaps = self._fusion.submaps()
        return PanopticMap(
            submaps=submaps,
            voxels=self._fusion,
            **_language(lambda: self._embeddings, lambda: create_look_encoder(self.config.perception)),
            label_embeddings=lambda: self._label_embeddings(submaps),
            report=self.report,
            frames=self._all_records,
            meta=MapMeta(config=self.config.model_dump_json(), provenance=self.provenance),
        )

    @exclusive
    def meshes(self, seconds: float = inf) -> dict[int, Mesh]:
        """Surfaces by id, frame map, freespace left out; what did not change, or is not reached in time, is kept."""
        return self._mesher.update(self._fusion.submaps(), self._fusion, seconds)

    def _label_embeddings(self, submaps: Sequence[Submap]) -> dict[str, npt.NDArray[np.float32]]:
        texts = sorted({r.text for s in submaps if s.descriptor for r in s.descriptor.labels})
        return dict(zip(texts, self._embeddings.encode(texts), strict=True))

    @exclusive
    def checkpoint(self) -> Checkpoint:
        """What changed since the last checkpoint."""
        submaps = self._fusion.submaps()
        changed, pruned = self._fusion.changes()
        frames, self._records = tuple(self._records), []
        return Checkpoint(
            submaps=submaps,
            changed=changed,
            pruned=pruned,
            merged=dict(self._fusion.merged),
            next_id=self._fusion.next_id,
            frames=frames,
            label_embeddings=self._label_embeddings(submaps),
            report=self.report,
        )

    def restore(self, saved: MapReader) -> None:
        """Go on from a saved map; the mapper must be new."""
        self._fusion.restore(saved.submaps(), saved, saved.next_id)
        self._embeddings = LabelEmbeddings(known=saved.label_embeddings())
        self._restored = saved.report()
        self.provenance = dict(saved.meta.provenance)
        self._timer = Timer(self._restored.seconds)
        self._all_records = list(saved.frames())


def category_similarity(encoder: TextEncoder) -> npt.NDArray[np.float32]:
    """Cosine (C, C) of the embeddings of the unified categories' names, in the table's order."""
    vectors = encoder.encode([category.name for category in unified_categories()])
    return vectors @ vectors.T


def open_map(path: str | Path) -> PanopticMap:
    """Open a map file for reading; no voxels are read until they are asked for, no encoder before the first query.

    Raises
    ------
    MapFileError
        There is no such file, or it is no map, damaged, or of a newer schema.
    """
    reader = CorrectedReader.open(path)
    language = _language(
        lambda: LabelEmbeddings(known=reader.label_embeddings()),
        lambda: create_look_encoder(saved_config(reader.meta).perception),
    )
    return PanopticMap.from_file(reader, **language)


def _language(encoder: Callable[[], TextEncoder], looks: Callable[[], TextEncoder]) -> dict[str, Any]:
    """What a map needs to understand a phrase."""
    understood = {"encoder": encoder, "category_embeddings": category_vectors, "look_encoder": looks}
    return understood | {"lemmatize": lemmatize, "tag": pos_tags}


def map_sequence(
    source: FrameSource,
    output: str | Path,
    config: Config | None = None,
    *,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress = lambda done, total: None,
    viewer: FrameViewer | None = None,
) -> Report:
    """Map a sequence into a file, a transaction every `config.map.checkpoint_every` frames.

    Parameters
    ----------
    resume : bool
        Go on after the last checkpoint of an existing map, with that map's own configuration.
    overwrite : bool
        Replace an existing map; it stays whole until the new one's first checkpoint.

    Raises
    ------
    MapFileError
        The file exists and neither option is given, or it cannot be written.
    BadFrameError
        A frame is bad and `config.input.strict`; otherwise bad frames are skipped and counted.
    InputError
        No frame can be used.
    """
    config = config or Config()
    if resume:
        mapper, writer, first = _resumed(source, output, viewer)
    else:
        # Before perception looks at any frame: that the file exists is known at once.
        check_free(Path(output), overwrite)
        mapper, first = Mapper(config, viewer=viewer), 0
        mapper.prepare(spread_frames(source))
        mapper.provenance |= {"sequence": source.name, "frames": str(len(source))}
        writer = MapWriter.create(output, mapper.config.model_dump_json(), mapper.provenance, overwrite=overwrite)
    with closing(mapper), writer:
        if first < len(source):
            _run(mapper, seen_by_camera(source, mapper.config.perception), first, writer, progress)
    return mapper.report


def _resumed(source: FrameSource, path: str | Path, viewer: FrameViewer | None) -> tuple[Mapper, MapWriter, int]:
    """The mapper and writer of a map at its last checkpoint, and the position of the next frame."""
    saved = MapReader.open(path)
    check_same(saved.meta, source, path)
    mapper, first = Mapper(saved_config(saved.meta), viewer=viewer), len(saved.frames())
    if first < len(source):
        mapper.prepare(spread_frames(source))
    mapper.restore(saved)
    saved.close()
    return mapper, MapWriter.resume(path), first


def check_same(meta: MapMeta, source: FrameSource, path: str | Path) -> None:
    made_of = (meta.provenance.get("sequence"), meta.provenance.get("frames"))
    if made_of != (source.name, str(len(source))):
        raise InputError(
            path,
            expected=f"the sequence that the map was begun with ({made_of[0]}, {made_of[1]} frames)",
            found=f"{source.name}, {len(source)} frames",
            advice="give that sequence with the same stride, or begin a new map",
        )


def _run(mapper: Mapper, source: FrameSource, first: int, writer: MapWriter, progress: Progress) -> None:
    every, total = mapper.config.map.checkpoint_every, len(source)

    def perceive(position: int) -> tuple[Frame, Percept]:
        if position % every == 0:
            # A resumed run begins behind a checkpoint, and must choose the same keyframes.
            mapper.front_end.restart()
        frame = source.frame(position)
        return frame, mapper.front_end.perceive(frame)

    for position, result in run_ahead(perceive, range(first, total), ahead=mapper.config.perception.ahead):
        try:
            mapper.fuse(*result())
        except BadFrameError as error:
            if mapper.config.input.strict:
                raise
            mapper.skip(source.indices[position], error.found)
        progress(position + 1, total)
        if (position + 1) % every == 0 and position + 1 < total and mapper.report.frames:
            writer.checkpoint(mapper.checkpoint())
    if not mapper.report.frames:
        raise nothing_usable(source.name, mapper.report.skipped, "see what `uppm check` says of the sequence")
    mapper.finish()
    # The last checkpoint follows `finish`, so that a map with all its frames is a finished one.
    writer.checkpoint(mapper.checkpoint())


def compare_maps(old_path: str | Path, path: str | Path, source: FrameSource, *, align: bool = False) -> PanopticMap:
    """Find out what became of an older map's objects; the result is written into the newer map and returned with it.

    Parameters
    ----------
    source : the sequence that the newer map was made of.
    align : estimate where the old map lies in the new one by their surfaces; otherwise both share a frame.

    Raises
    ------
    MapFileError
        One of the files cannot be read, or the newer one not written.
    InputError
        The source is another sequence, or the maps do not come to lie on each other.
    """
    from uppm.fusion.change import detect_changes, surfaces
    from uppm.fusion.registration import moved, register
    from uppm.fusion.seeing import rendered_views
    from uppm.fusion.tracking import CategoryPolicy

    old, new = open_map(old_path), open_map(path)
    check_same(new.meta, source, path)
    settings, T, notes = saved_config(new.meta).fusion, np.eye(4), {"onto": str(old_path)}
    if align:
        found = register(old.mesh(), new.mesh())
        T = found.T_new_old
        notes |= {"onto.T_map_old": " ".join(f"{value:.9g}" for value in T.ravel())}
        notes |= {"onto.fitness": f"{found.fitness:.4f}", "onto.rmse": f"{found.rmse:.5f}"}
    poses = [T @ record.T_map_camera for record in old.frames if record.T_map_camera is not None]
    similarity = category_similarity(LabelEmbeddings(known=new.label_embeddings))
    changes = detect_changes(
        surfaces(old.submaps, lambda id_: moved(old.submap_mesh(id_), T)),
        surfaces(new.submaps, new.submap_mesh),
        good_frames(source),
        lambda points: rendered_views(moved(old.mesh(), T), poses, next(good_frames(source)).intrinsics, points),
        CategoryPolicy(settings.category_policy, settings.min_cosine, similarity),
    )
    with MapWriter.resume(path) as writer:
        writer.forget("onto")
        for key, value in notes.items():
            writer.note(key, value)
        writer.record_changes(changes)
    return open_map(path)
