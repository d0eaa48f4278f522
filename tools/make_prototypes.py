"""Write src/uppm/data/wordnet_prototypes.csv: what WordNet calls each category, and how it explains it.

Takes the synsets that src/uppm/data/category_synsets.csv names by hand, and WordNet's database:

    apt-get download wordnet-base && dpkg-deb -x wordnet-base_*.deb unpacked
    python tools/make_prototypes.py unpacked/usr/share/wordnet

Words that the table written by hand has for any category are left out, and so are names. Run tools/make_embeddings.py
after it.
"""

from __future__ import annotations

import argparse
import csv
import re
from collections.abc import Iterator
from pathlib import Path

from uppm.perception.labels.lemma import lemmatize
from uppm.perception.retrieval.hypernyms import curated_synsets
from uppm.perception.retrieval.prototypes import lexicon

OUT = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data" / "wordnet_prototypes.csv"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("database", type=Path, help="folder with data.noun")
    parser.add_argument("--output", type=Path, default=OUT)
    arguments = parser.parse_args()
    synsets = dict(read_synsets(arguments.database / "data.noun"))
    with arguments.output.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("name", "terms", "glosses"))
        for name, own in curated_synsets():
            lemmas = [lemma for _, offset in own for lemma in synsets[offset][0]]
            terms = [lemma for lemma in lemmas if lemma.islower() and lemmatize(lemma) not in lexicon()]
            writer.writerow((name, "|".join(dict.fromkeys(terms)), "|".join(synsets[offset][1] for _, offset in own)))


def read_synsets(file: Path) -> Iterator[tuple[str, tuple[list[str], str]]]:
    """Offset, lemmas, and the gloss up to its first semicolon, without a field of use in brackets before it."""
    for line in file.read_text(encoding="latin-1").splitlines():
        if line.startswith("  "):
            continue
        head, _, gloss = line.partition(" | ")
        fields = head.split()
        lemmas = [lemma.replace("_", " ") for lemma in fields[4 : 4 + 2 * int(fields[3], 16) : 2]]
        yield str(int(fields[0])), (lemmas, re.sub(r"^\([^)]*\) ", "", gloss).split(";")[0].strip())


if __name__ == "__main__":
    main()
