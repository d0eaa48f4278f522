"""Write src/uppm/data/wordnet.json.zst: WordNet 3.0's nouns, what each is a kind of, and irregular plurals.

    apt-get download wordnet-base && dpkg-deb -x wordnet-base_*.deb unpacked
    python tools/make_wordnet.py unpacked/usr/share/wordnet

Left out: names of persons and places (instances), the Latin names of animals and plants, glosses, all other relations.
The same input gives the same bytes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import zstandard

OUT = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data" / "wordnet.json.zst"
TAXA = {"05", "20"}
"""Lexicographer files of animals and plants."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("database", type=Path, help="folder with data.noun, index.noun, noun.exc, ...")
    parser.add_argument("--output", type=Path, default=OUT)
    arguments = parser.parse_args()
    parents = dict(synsets(arguments.database))
    order = {offset: number for number, offset in enumerate(sorted(parents))}
    senses = {
        lemma: [order[offset] for offset in offsets if offset in order]
        for lemma, offsets in index(arguments.database / "index.noun")
    }
    nouns = sorted(lemma for lemma, own in senses.items() if own)
    tables = {
        "synsets": rows([offset] for offset in sorted(parents)),
        "hypernyms": rows([order[p] for p in parents[offset] if p in order] for offset in sorted(parents)),
        "nouns": "\n".join(nouns),
        "senses": rows(senses[lemma] for lemma in nouns),
        "no_nouns": "\n".join(sorted(others(arguments.database) - senses.keys())),
        "noun_exceptions": exceptions(arguments.database / "noun.exc"),
    }
    text = json.dumps(tables, separators=(",", ":"), ensure_ascii=False)
    arguments.output.write_bytes(zstandard.ZstdCompressor(level=22).compress(text.encode("utf-8")))


def rows(numbers: Iterable[Sequence[int]]) -> str:
    """Numbers as lines of text: quicker to read than JSON, and looked at line by line."""
    return "\n".join(" ".join(map(str, line)) for line in numbers)


def lines(file: Path) -> Iterator[list[str]]:
    """The fields of each line but the licence's, which begin with blanks."""
    for line in file.read_text(encoding="latin-1").splitlines():
        if not line.startswith("  "):
            yield line.split()


def synsets(database: Path) -> Iterator[tuple[int, list[int]]]:
    """Offset and hypernyms of each noun synset that is kept."""
    for fields in lines(database / "data.noun"):
        words = int(fields[3], 16)
        names = fields[4 : 4 + 2 * words : 2]
        pointers = fields[5 + 2 * words :]
        links = [pointers[i : i + 2] for i in range(0, 4 * int(fields[4 + 2 * words]), 4)]
        latin = fields[1] in TAXA and all(name[0].isupper() for name in names)
        if not latin and not any(kind == "@i" for kind, _ in links):
            yield int(fields[0]), [int(offset) for kind, offset in links if kind == "@"]


def index(file: Path) -> Iterator[tuple[str, list[int]]]:
    """Lemma with blanks for underscores, and its synsets' offsets, the commonest sense first."""
    for fields in lines(file):
        yield fields[0].replace("_", " "), [int(offset) for offset in fields[-int(fields[2]) :]]


def others(database: Path) -> set[str]:
    """Single words that are verbs, adjectives or adverbs."""
    files = (database / f"index.{part}" for part in ("verb", "adj", "adv"))
    return {lemma for file in files for lemma, _ in index(file) if lemma.isalpha()}


def exceptions(file: Path) -> dict[str, str]:
    """Inflected form -> lemma, the first where there are several."""
    return {fields[0].replace("_", " "): fields[1].replace("_", " ") for fields in lines(file)}


if __name__ == "__main__":
    main()
