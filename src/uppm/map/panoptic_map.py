"""The panoptic map as a user sees it: the same over a running fusion and over a map file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from uppm.core.categories import plain_name, unified_categories
from uppm.core.errors import InputError
from uppm.core.protocols import TextEncoder, VoxelSource
from uppm.core.types import Change, FrameRecord, Mesh, Report, Submap, SubmapKind, SubmapState, VoxelBlocks
from uppm.map.corrections import Correction
from uppm.map.looks import Looks
from uppm.map.palette import submap_color
from uppm.map.query import Answer, SearchIndex
from uppm.map.store import MapMeta, MapReader

if TYPE_CHECKING:
    from uppm.map.answer import Reply
    from uppm.map.scene import Scene

Coloring = Literal["color", "instance", "category"]
Vector = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class QueryResult:
    """What a map answers to a phrase."""

    text: str
    """As asked."""
    results: tuple[Answer, ...]
    """The submaps that are more likely meant than not, the most probable first; none: nothing here matches."""
    closest: tuple[Answer, ...]
    """Where nothing matches: the submaps that come closest."""
    note: str = ""
    """What could not be asked of it."""

    @property
    def found(self) -> bool:
        """Something in the map matches."""
        return bool(self.results)

    def to_dict(self) -> dict[str, Any]:
        """What `uppm query --json` prints."""
        return {
            "query": self.text,
            "found": self.found,
            "results": [_answer_dict(answer) for answer in self.results],
            "closest": [_answer_dict(answer) for answer in self.closest],
        } | ({"note": self.note} if self.note else {})


class PanopticMap:
    """Submaps with their labels and report as they were when it was made; each surface is meshed once.

    Voxels are read when they are needed: of a running fusion, they are those of that moment.

    Parameters
    ----------
    submaps : the map's submaps, by id.
    voxels : where their voxels are; asked only when they are needed.
    encoder : makes the text encoder, on the first query.
    category_embeddings : makes category id -> unit vectors, (D,) or (K, D), on the first query; None: of the names.
    look_encoder : makes the text side of the model of the submaps' visual features, on the first query; None: they
        do not count.
    lemmatize : brings a query into the form of the labels.
    tag : part-of-speech tags of words, for questions; without it every phrase is a plain one.
    label_embeddings : label text -> unit vector (D,), as stored with the map; or what makes them, on the first query.
    """

    def __init__(
        self,
        *,
        submaps: Iterable[Submap],
        voxels: VoxelSource,
        encoder: Callable[[], TextEncoder] | None = None,
        category_embeddings: Callable[[], Mapping[int, Vector]] | None = None,
        look_encoder: Callable[[], TextEncoder] | None = None,
        lemmatize: Callable[[str], str] = str.lower,
        tag: Callable[[Sequence[str]], Sequence[str]] | None = None,
        label_embeddings: Mapping[str, Vector] | Callable[[], Mapping[str, Vector]] | None = None,
        report: Report | None = None,
        frames: Iterable[FrameRecord] = (),
        changes: Iterable[Change] = (),
        corrections: Iterable[Correction] = (),
        meta: MapMeta | None = None,
    ) -> None:
        self.submaps = tuple(submaps)
        self.frames = tuple(frames)
        self.changes = tuple(changes)
        """What became of the objects of the older map that this one was compared with."""
        self.corrections = tuple(corrections)
        """What was corrected by hand and not undone; the submaps are as corrected."""
        self.report = report or Report()
        self.meta = meta or MapMeta()
        self._label_embeddings = label_embeddings or {}
        self._by_id = {submap.id: submap for submap in self.submaps}
        self._meshes: dict[int, Mesh] = {}
        self._voxels, self._make_encoder, self._lemmatize, self._tag = voxels, encoder, lemmatize, tag
        self._make_categories = category_embeddings or self._encoded_names
        self._make_look_encoder = look_encoder
        self.has_voxels = True
        """False: only its surfaces can be asked about (`of_surfaces`)."""

    def of_surfaces(self, meshes: Mapping[int, Mesh]) -> PanopticMap:
        """The same map with these surfaces by submap id, and no voxels: for questions while those change.

        A submap without a mesh has no surface, and rooms are not told apart.
        """
        from uppm.map.mesh import empty_mesh

        surfaces = copy(self)
        surfaces._meshes = {submap.id: meshes.get(submap.id) or empty_mesh() for submap in self.submaps}
        surfaces.__dict__.pop("_scene", None)
        surfaces.has_voxels = False
        return surfaces

    @classmethod
    def from_file(
        cls,
        reader: MapReader,
        *,
        encoder: Callable[[], TextEncoder] | None = None,
        category_embeddings: Callable[[], Mapping[int, Vector]] | None = None,
        look_encoder: Callable[[], TextEncoder] | None = None,
        lemmatize: Callable[[str], str] = str.lower,
        tag: Callable[[Sequence[str]], Sequence[str]] | None = None,
    ) -> PanopticMap:
        """The map of an open file; no voxels are read yet."""
        return cls(
            submaps=reader.submaps(),
            voxels=reader,
            encoder=encoder,
            category_embeddings=category_embeddings,
            look_encoder=look_encoder,
            lemmatize=lemmatize,
            tag=tag,
            label_embeddings=reader.label_embeddings(),
            report=reader.report(),
            frames=reader.frames(),
            changes=reader.changes(),
            corrections=(c for c in reader.corrections() if not c.undone),
            meta=reader.meta,
        )

    @property
    def objects(self) -> tuple[Submap, ...]:
        """The things that were seen often enough to be believed."""
        return tuple(s for s in self.submaps if s.kind is SubmapKind.OBJECT and s.state is not SubmapState.TENTATIVE)

    @property
    def up(self) -> npt.NDArray[np.float64]:
        """(3,) unit vector against gravity in frame map, as noted with the map under `up` ("x y z"); else +z."""
        values = [float(v) for v in self.meta.provenance.get("up", "0 0 1").split()]
        return np.array(values) / np.linalg.norm(values)

    def submap(self, submap_id: int) -> Submap:
        """The submap of an id; raises `InputError` where there is none."""
        if submap_id not in self._by_id:
            raise InputError(
                f"submap {submap_id}",
                expected="an id of this map",
                found="none such",
                advice="`uppm info` lists the ids",
            )
        return self._by_id[submap_id]

    def blocks(self, submap_id: int) -> VoxelBlocks:
        """Voxels of a submap."""
        return self._voxels.blocks(self.submap(submap_id).id)

    def submap_mesh(self, submap_id: int, coloring: Coloring = "color") -> Mesh:
        """Surface of one submap, frame map; freespace has none."""
        from uppm.map.mesh import empty_mesh, submap_mesh

        submap = self.submap(submap_id)
        if submap_id not in self._meshes:
            freespace = submap.kind is SubmapKind.FREESPACE
            self._meshes[submap_id] = empty_mesh() if freespace else submap_mesh(submap, self.blocks(submap_id))
        mesh = self._meshes[submap_id]
        if coloring == "color":
            return mesh
        colors = np.tile(np.array(submap_color(submap, coloring), dtype=np.uint8), (len(mesh.vertices), 1))
        return Mesh(vertices=mesh.vertices, normals=mesh.normals, colors=colors, faces=mesh.faces)

    def mesh(self, coloring: Coloring = "color", ids: Iterable[int] | None = None) -> Mesh:
        """Surfaces of the confirmed and inactive submaps, or of `ids`, in one mesh, frame map."""
        from uppm.map.mesh import merged

        if ids is None:
            ids = [s.id for s in self.submaps if s.state is not SubmapState.TENTATIVE]
        return merged([self.submap_mesh(id_, coloring) for id_ in ids])

    def query(self, text: str, limit: int = 5) -> QueryResult:
        """Which submaps a phrase means (method.md section 6); reads no voxels.

        Raises
        ------
        InputError
            The phrase is empty, or the map was made without an encoder.
        """
        phrase = self._lemmatize(text.strip())
        if not phrase:
            raise InputError("query", expected="a phrase such as 'coffee mug'", found=repr(text), advice="name a thing")
        answers = self._search(phrase, limit)
        results = tuple(answer for answer in answers if answer.found)[:limit]
        closest = () if results else tuple(answers[:limit])
        return QueryResult(text=text, results=results, closest=closest, note=self._looks.note)

    def rank(self, text: str) -> list[Answer]:
        """Every submap that has a label, found or not, the most probable first."""
        return self._search(self._lemmatize(text), len(self.submaps))

    def ask(self, text: str, limit: int = 5, viewpoint: npt.ArrayLike | None = None) -> Reply:
        """What answers a question, such as 'how many chairs are in the kitchen' (docs/query.md).

        A plain phrase is answered by `query`, and so is a sentence that the grammar does not cover: the note says so.

        Parameters
        ----------
        viewpoint : (3,), optional
            Where one looks from, frame map, metres, for `left of` and the like, and for `nearest`.
        """
        from uppm.map.answer import Answerer, Reply
        from uppm.map.question import is_question, parse

        if self._tag is None or not is_question(text) or self._lemmatize(text) in self._names:
            return Reply(text=text, plain=self.query(text, limit))
        question = parse(text, self._tag)
        if question is None:
            return Reply(text=text, plain=self.query(text, limit), note="not understood, searched as a plain phrase")
        place = None if viewpoint is None else self._scene.upright(np.asarray(viewpoint, dtype=np.float64))
        answerer = Answerer(self.rank, self.objects, self._scene, self._lemmatize, place)
        found, note = answerer.answer(question)
        return Reply(
            text=text,
            understood=str(question),
            results=tuple(found[:limit]),
            count=len(found),
            counting=question.count,
            note=note,
        )

    @cached_property
    def label_embeddings(self) -> Mapping[str, Vector]:
        """Label text -> unit vector (D,)."""
        return self._label_embeddings() if callable(self._label_embeddings) else self._label_embeddings

    @property
    def rooms(self) -> dict[int, str]:
        """Room -> its kind by what is in it (`kitchen`); rooms of no known kind are left out (docs/query.md)."""
        return dict(self._scene.room_names)

    @cached_property
    def _scene(self) -> Scene:
        from uppm.map.scene import Scene

        return Scene(self)

    def _search(self, phrase: str, closest: int) -> list[Answer]:
        return self._index.rank(phrase, self._encoder.encode([phrase])[0], closest, self._looks.of(phrase))

    @cached_property
    def _index(self) -> SearchIndex:
        believed = [s for s in self.submaps if s.state is not SubmapState.TENTATIVE]
        return SearchIndex(believed, self.label_embeddings, self._make_categories(), self._looks.categories)

    @cached_property
    def _looks(self) -> Looks:
        seen = any(s.descriptor and s.descriptor.feature for s in self.submaps)
        return Looks.made(self._make_look_encoder) if seen and self._make_look_encoder else Looks()

    @cached_property
    def _names(self) -> frozenset[str]:
        """What labels and categories are called: `orange juice` is one, and no question."""
        labels = {r.text for s in self.submaps if s.descriptor for r in s.descriptor.labels}
        return frozenset(labels | {plain_name(category.name) for category in unified_categories()})

    @cached_property
    def _encoder(self) -> TextEncoder:
        if self._make_encoder is None:
            advice = "open it with uppm.open_map, or pass `encoder`"
            raise InputError("query", expected="a map with a text encoder", found="none", advice=advice)
        return self._make_encoder()

    def _encoded_names(self) -> Mapping[int, Vector]:
        categories = unified_categories()
        vectors = self._encoder.encode([category.name for category in categories])
        return {category.id: vector for category, vector in zip(categories, vectors, strict=True)}

    def to_dict(self) -> dict[str, Any]:
        """What `uppm info --json` prints: lengths in metres, frame map."""
        return {
            "frames": self.report.frames,
            "units": "m",
            "up": _rounded(self.up),
            "submaps": [submap_dict(s) for s in self.submaps],
            "changes": [change_dict(c) for c in self.changes],
            "corrections": [asdict(c) for c in self.corrections],
            "report": {
                "frames": self.report.frames,
                "skipped": dict(self.report.skipped),
                "dropped": dict(self.report.dropped),
                "seconds": dict(self.report.seconds),
            },
        }


def submap_dict(submap: Submap) -> dict[str, Any]:
    """One submap for programs; `center` and `extent` are None where no surface was seen."""
    seen = bool(np.isfinite(submap.bounds).all())
    descriptor = submap.descriptor
    return {
        "id": submap.id,
        "kind": submap.kind.value,
        "category": descriptor.category.name if descriptor else None,
        "confidence": round(descriptor.confidence, 4) if descriptor else None,
        "labels": {record.text: record.count for record in descriptor.labels} if descriptor else {},
        "voxel_size": submap.voxel_size,
        "center": _rounded(submap.center) if seen else None,
        "extent": _rounded(submap.extent) if seen else None,
        "state": submap.state.value,
        "first_frame": submap.first_frame,
        "last_frame": submap.last_frame,
    }


def change_dict(change: Change) -> dict[str, Any]:
    """One change for programs; centres in metres, frame map."""
    old, new = (None if c is None else _rounded(c) for c in (change.center_old, change.center_new))
    return {
        "state": change.state.value,
        "id_old": change.id_old,
        "id_new": change.id_new,
        "category": change.category,
        "label": change.label,
        "center_old": old,
        "center_new": new,
        "evidence": dict(change.evidence),
    }


def _answer_dict(answer: Answer) -> dict[str, Any]:
    place = {key: value for key, value in submap_dict(answer.submap).items() if key in ("center", "extent")}
    return {
        "id": answer.submap.id,
        "category": answer.submap.descriptor.category.name if answer.submap.descriptor else None,
        "matched_label": answer.label,
        "score": round(answer.score, 4),
        "probability": round(answer.probability, 4),
        **place,
    }


def _rounded(values: npt.NDArray[np.float64]) -> list[float]:
    return [round(float(v), 4) for v in values]
