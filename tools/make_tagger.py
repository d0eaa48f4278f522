"""Write src/uppm/data/tagger.json.zst: Honnibal's perceptron tagger, from the sdist of textblob-aptagger 0.2.0.

    pip download textblob-aptagger==0.2.0 --no-deps --no-binary :all:
    python tools/make_tagger.py textblob-aptagger-0.2.0.tar.gz

The model is a pickle; it is read by an unpickler that knows no class but `set`. The same input gives the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import pickle
import tarfile
from pathlib import Path
from typing import Any

import zstandard

MEMBER = "textblob-aptagger-0.2.0/textblob_aptagger/trontagger-0.1.0.pickle"
SHA256 = "1109164b3d28dce58f96b763128bab2fd8754c3921fd3330de2724ac6d1ada7c"
OUT = Path(__file__).resolve().parents[1] / "src" / "uppm" / "data" / "tagger.json.zst"


class SetsOnly(pickle.Unpickler):
    """Builds containers, texts and numbers; any global but `set` is refused."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in {("__builtin__", "set"), ("builtins", "set")}:
            raise pickle.UnpicklingError(f"{module}.{name} has no place in a tagger's weights")
        return set


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sdist", type=Path)
    parser.add_argument("--output", type=Path, default=OUT)
    arguments = parser.parse_args()
    with tarfile.open(arguments.sdist) as archive:
        member = archive.extractfile(MEMBER)
        data = member.read() if member else b""
    found = hashlib.sha256(data).hexdigest()
    if found != SHA256:
        raise SystemExit(f"{arguments.sdist}: {MEMBER} has sha256 {found}, expected {SHA256}")
    weights, tag_of, classes = SetsOnly(io.BytesIO(data), encoding="utf-8").load()
    features = sorted(weights)
    model = {
        "classes": sorted(classes),
        "tag_of": tag_of,
        "features": features,
        "weights": [weights[feature] for feature in features],
    }
    text = json.dumps(model, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    arguments.output.write_bytes(zstandard.ZstdCompressor(level=22).compress(text.encode("utf-8")))


if __name__ == "__main__":
    main()
