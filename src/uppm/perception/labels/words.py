"""The hand-made word lists of label parsing (docs/labels.md says why each word is where it is)."""

from __future__ import annotations


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


ROOMS = _words("""
room living dining kitchen bedroom bathroom office hallway hall corridor garage basement attic library classroom
restaurant lobby studio area space apartment house home building store shop hotel hospital museum gym church school
kitchenette washroom restroom foyer cellar interior indoors outdoors
""")
"""Where the camera is, not what it sees: a submap is never a room."""

FRAMING = _words("""
photo photograph image view shot close-up closeup close scene background foreground snapshot
perspective angle
""")
"""What the caption says of itself."""

THIS = _words("the this")
"""With them `picture` is the caption's own image; `a picture` hangs on a wall."""

PLACES = _words("""
top bottom side left right front back rear corner middle center centre edge end part area space place spot section
inside outside distance direction row line level surface half other rest way arrangement design
style decor color colour shape size kind type sort variety number lot couple bunch group pair set piece time day night
sunlight shadow reflection writing text word something nothing everything anything one
someone item object thing stuff content detail feature
""")
"""Parts and places of other things, quantities, and words that name nothing one could point at."""

BODY = _words("hand hands arm arms finger fingers leg legs foot feet lap head face hair eye eyes mouth")
"""Parts of a person, who is labelled as a whole."""

STOP = ROOMS | FRAMING | PLACES | BODY
"""Head nouns that make no label where no other noun stands before them: `top`, but `counter top`."""
ALWAYS_STOP = ROOMS | FRAMING
"""Head nouns that make no label: `dining room`."""

MEASURES = _words("""
pair stack pile heap bunch set piece slice row group lot couple number variety collection roll loaf line series
assortment array cluster bundle sheet kind type sort dozen handful range selection
""")
"""What comes before `of` without being the thing: `pile of books` is books."""

DEPICTIONS = _words("painting picture photo photograph poster drawing portrait print statue sculpture figurine map")
"""What shows a thing that is not there: `painting of a woman` is a painting."""

VAGUE = _words("""
other various different several many few some more most own same such certain first second third fourth last next
nice beautiful good great new modern typical single double-sided multiple numerous assorted large big small little tiny
huge tall short long giant visible able full left right top bottom upper lower front back rear main whole entire
""")
"""Modifiers that say nothing which helps to find the thing: counts, opinions, places, sizes."""

COLORS = _words("""
black white red green blue yellow orange brown gray grey pink purple beige tan silver gold golden turquoise teal maroon
""")
"""They are joined by `and`: `black and white cat` is one thing."""

ACTIONS = _words("""
sit stand lie lay lead attach fill wear hang play walk ride hold catch cut stretch run jump look watch eat drink sleep
stack throw hit swing pull push open close turn carry cook talk smile pose wave work move fly travel perch prepare serve
""")
"""One-word tags that taggers give for what happens, though each is a noun as well."""

BLURRY = _words("blurry blurred blur out-of-focus unfocused")
"""What a captioner calls a frame that is not sharp."""
