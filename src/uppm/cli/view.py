"""`uppm view`: a map in the browser."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uppm.core.protocols import FrameSource
    from uppm.core.shown import Content, Shown
    from uppm.map.panoptic_map import PanopticMap
    from uppm.viewer.served import ServedMap


def view(
    path: Annotated[Path, typer.Argument(metavar="MAP", readable=False, help="Map file written by `uppm map`.")],
    export: Annotated[
        Path | None, typer.Option(metavar="HTML", help="Write one file that needs no program, instead of serving.")
    ] = None,
    sequence: Annotated[
        Path | None, typer.Option(help="The sequence that the map was made of, for pictures of its objects.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to serve at; any but loopback asks for a token.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; the next free one where it is in use.")] = 8080,
) -> None:
    """Look at a map: its objects, what is known of them, and answers to prompts."""
    from uppm.map.shown import content_of
    from uppm.pipeline import open_map

    panoptic = open_map(path)
    source = open_source(panoptic, path, sequence) if sequence else None
    if export:
        check_name(export)
        export_page(content_of(panoptic, path.stem), export, source)
    else:
        serve(content_of(panoptic, path.stem), source, host, port)


def open_source(panoptic: PanopticMap, path: Path, sequence: Path) -> FrameSource:
    """The sequence of a map, read as it was read for mapping; raises `InputError` where it is another."""
    from uppm.pipeline import check_same, open_sequence, saved_config

    source = open_sequence(sequence, saved_config(panoptic.meta).input)
    check_same(panoptic.meta, source, path)
    return source


def check_name(file: Path) -> None:
    """Raise `InputError` where a page's name does not end as one."""
    from uppm.core.errors import InputError

    if file.suffix.lower() not in (".html", ".htm"):
        expected = "a name ending in .html"
        raise InputError(file, expected=expected, found=repr(file.suffix), advice="name the file so")


def export_page(content: Content, file: Path, source: FrameSource | None) -> None:
    """Write a map as one HTML file."""
    from uppm.export.files import write_bytes
    from uppm.viewer.crops import best_crops
    from uppm.viewer.html import map_page

    crops = {}
    if source is not None:
        found = best_crops({s.submap.id: s.mesh for s in content.shown if s.is_object}, content.path, source)
        crops = {id_: [crop.jpeg() for crop in views] for id_, views in found.items()}
    write_bytes(file, map_page(content, crops).encode())
    typer.echo(str(file))


def serve(content: Content, source: FrameSource | None, host: str, port: int) -> None:
    """Serve a map until the program is interrupted."""
    from uppm.viewer.served import ServedMap

    served = ServedMap(host=host, port=port)
    served.pictures = pictures_of(content, source)
    served.show(content)
    until_interrupted(served, lambda: typer.echo(f"{served.url}  (Ctrl-C ends)"))


def pictures_of(content: Content, source: FrameSource | None) -> Callable[[Shown], list[bytes]]:
    """Best views of a map's objects; none without its sequence."""
    from uppm.viewer.crops import best_crops

    def pictures(shown: Shown) -> list[bytes]:
        if source is None:
            return []
        found = best_crops({shown.submap.id: shown.mesh}, content.path, source)
        return [crop.jpeg() for crop in found.get(shown.submap.id, ())]

    return pictures


def until_interrupted(served: ServedMap, say: Callable[[], None]) -> None:
    """Say so, and wait for Ctrl-C, which may come at once."""
    try:
        say()
        Event().wait()
    except KeyboardInterrupt:
        served.close()


class WatchedRun:
    """`--view`: the map in the browser while it is made, and afterwards until Ctrl-C.

    Without a source, of a camera say, there are no pictures of objects.
    """

    def __init__(self, host: str, port: int, source: FrameSource | None) -> None:
        from uppm.viewer.live import LiveViewer
        from uppm.viewer.served import ServedMap

        self._source, self._served = source, ServedMap(host=host, port=port)
        self.viewer = LiveViewer(self._served.show, lambda: self._served.watched)
        typer.echo(self._served.url, err=True)

    def stay(self, output: Path) -> None:
        """Show the finished map, which answers questions too."""
        from uppm.map.shown import content_of
        from uppm.pipeline import open_map

        self.viewer.close()
        content = content_of(open_map(output), output.stem)
        self._served.pictures = pictures_of(content, self._source)
        self._served.show(content)
        said = f"{self._served.url}  shows the finished map (Ctrl-C ends)"
        until_interrupted(self._served, lambda: typer.echo(said, err=True))
