"""The served page's panel: prompt, colours, toggles, time, screenshot, and what is known of an object."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from uppm.core.errors import UppmError
from uppm.core.shown import COLORINGS, Answers, Shown
from uppm.viewer.facts import answers_html, changes_html, facts_html

Changed = Callable[..., None]
"""Takes fields of `Look` by name."""


class Panel:
    """The controls, which every browser shares.

    Parameters
    ----------
    gui : viser's.
    changed : told of each field of `Look` that was chosen.
    ask : answers a prompt, and flies the browser that asked to the best.
    whole : flies a browser to where it sees everything.
    """

    def __init__(
        self, gui: Any, *, changed: Changed, ask: Callable[[str, Any], Answers], whole: Callable[[Any], None]
    ) -> None:
        self._gui, self._changed, self._ask = gui, changed, ask
        self._boxes: dict[str, Any] = {}
        self._add_prompt()
        self._facts = gui.add_html("", visible=False)
        coloring = gui.add_dropdown("Colour", COLORINGS, initial_value=COLORINGS[0])
        coloring.on_update(lambda _: changed(coloring=coloring.value))
        self._changes = gui.add_html("", visible=False)
        self._time = gui.add_slider("Up to frame", min=0, max=1, step=1, initial_value=1)
        self._time.on_update(lambda _: changed(until=self.until))
        for name, field in (("Camera path", "path"), ("Freespace", "free")):
            self._add_toggle(name, field)
        gui.add_button("Whole map").on_click(lambda event: whole(event.client))
        gui.add_button("Screenshot").on_click(lambda event: save_picture(event.client))
        self._categories = gui.add_folder("Categories", expand_by_default=False)

    @property
    def until(self) -> int | None:
        """The frame that the slider is at; None at its end, where frames to come are shown too."""
        return None if self._time.value >= self._time.max else int(self._time.value)

    def update(self, shown: Sequence[Shown], last_frame: int, gone: Sequence[Mapping[str, Any]] = ()) -> None:
        """Take over a newer map: its categories, how many frames it has, and what an older one had."""
        changes = changes_html(shown, gone)
        self._changes.content, self._changes.visible = changes, bool(changes)
        at_end, last = self._time.value >= self._time.max, max(1, last_frame)
        if self._time.max != last:
            self._time.max = last
            if at_end:
                self._time.value = last
        counts = Counter(str(s.facts["category"]) for s in shown)
        for category in sorted(counts):
            if category not in self._boxes:
                with self._categories:
                    self._boxes[category] = self._gui.add_checkbox(category, True)
                self._boxes[category].on_update(lambda _: self._changed(hidden=self.hidden))

    @property
    def hidden(self) -> frozenset[str]:
        """Categories whose boxes are empty."""
        return frozenset(category for category, box in self._boxes.items() if not box.value)

    def tell(self, shown: Shown | None, jpegs: Iterable[bytes] = ()) -> None:
        """Show what is known of an object; None: of none."""
        self._facts.content = facts_html(shown, list(jpegs)) if shown else ""
        self._facts.visible = shown is not None

    def _add_prompt(self) -> None:
        with self._gui.add_form(None) as form:
            self.prompt = self._gui.add_text("Prompt", "", hint="A thing, or a question, and Enter")
        self._answer = self._gui.add_html("", visible=False)

        @form.on_submit
        def _(event: Any) -> None:
            self._answered(self.prompt.value, event.client)

    def _answered(self, text: str, client: Any) -> None:
        try:
            answers = self._ask(text, client)
        except UppmError as error:
            answers = Answers(ids=(), said=(str(error),))
        self._answer.content, self._answer.visible = answers_html(answers), bool(answers.said)

    def _add_toggle(self, name: str, field: str) -> None:
        box = self._gui.add_checkbox(name, False)
        box.on_update(lambda _: self._changed(**{field: box.value}))


def save_picture(client: Any) -> None:
    """Let a browser save what it shows as a picture."""
    import cv2
    import numpy as np

    image = client.get_render(client.camera.image_height, client.camera.image_width, timeout=20.0)
    encoded = cv2.imencode(".png", np.ascontiguousarray(image[..., 2::-1]))[1]
    client.send_file_download("map.png", encoded.tobytes(), save_immediately=True)
