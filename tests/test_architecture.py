"""The rules of the house, read from the source: layers, lengths, and what `import uppm` may load."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[1] / "src"
FILES = sorted((SOURCE / "uppm").rglob("*.py"))
STAGES = {"datasets", "perception", "fusion", "map", "evaluation", "export", "viewer"}
MAY_IMPORT = {
    "core": {"core"},
    "_kernels": {"_kernels"},
    "data": set[str](),
    "fusion": {"fusion", "core", "_kernels"},
    "map": {"map", "core", "_kernels"},
    **{stage: {stage, "core"} for stage in STAGES - {"fusion", "map"}},
}
COMPOSERS = {"bench", "cli", "editing", "live", "pipeline", "regimes", "studies", ""}
"""The last is the package's own `__init__`."""
HEAVY = {"torch", "transformers", "numba", "cv2", "trimesh", "viser", "scipy", "skimage", "onnxruntime", "open3d"}
MAX_FILE, MAX_FUNCTION, USUAL_FUNCTION = 400, 60, 25


def layer_of(path: Path) -> str:
    """Folder or module directly below the package that a file belongs to; empty for the package's `__init__`."""
    first = path.relative_to(SOURCE / "uppm").parts[0]
    return first.removesuffix(".py").replace("__init__", "")


def imported_layers(path: Path, tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and layer of each import of ours, relative ones and those for type checking included."""
    package = path.relative_to(SOURCE).parts[:-1]
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*base, *filter(None, [node.module])))
            names = [f"{module}.{alias.name}" for alias in node.names]
        for name in names:
            parts = name.split(".")
            if parts[0] == "uppm" and len(parts) > 1:
                yield node.lineno, parts[1]  # pyright: ignore[reportAttributeAccessIssue]


def violations(path: Path, text: str) -> list[str]:
    layer = layer_of(path)
    if layer in COMPOSERS:
        return []
    return [
        f"{path.relative_to(SOURCE)}:{line}: {layer} imports {other}"
        for line, other in imported_layers(path, ast.parse(text))
        if other not in MAY_IMPORT[layer]
    ]


def function_lengths(tree: ast.AST) -> Iterator[tuple[ast.FunctionDef | ast.AsyncFunctionDef, int]]:
    """Each function and its lines, the docstring left out."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            documented = ast.get_docstring(node) is not None and len(node.body) > 1
            first = node.body[1].lineno if documented else node.lineno
            yield node, (node.end_lineno or node.lineno) - first + 1


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_file(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert violations(path, text) == []
    assert text.count("\n") <= MAX_FILE
    assert [node.name for node, length in function_lengths(ast.parse(text)) if length > MAX_FUNCTION] == []


def test_nine_functions_of_ten_are_short() -> None:
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in FILES]
    lengths = [length for tree in trees for _, length in function_lengths(tree)]
    assert sum(length <= USUAL_FUNCTION for length in lengths) >= 0.9 * len(lengths)


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("datasets/new.py", "from uppm.fusion.pool import Pool", "datasets imports fusion"),
        ("datasets/new.py", "from uppm import map", "datasets imports map"),
        ("perception/masks/new.py", "from ...fusion import pool", "perception imports fusion"),
        ("perception/new.py", "def f():\n    import uppm._kernels.camera", "perception imports _kernels"),
        ("core/new.py", "import uppm.pipeline", "core imports pipeline"),
        ("_kernels/new.py", "from uppm.core.types import Mesh", "_kernels imports core"),
    ],
)
def test_the_layer_rule_sees_each_form_of_import(file: str, text: str, said: str) -> None:
    (found,) = violations(SOURCE / "uppm" / file, text)
    assert found.endswith(said)


def test_the_layer_rule_lets_pass_what_it_should() -> None:
    for file, text in (
        ("fusion/new.py", "from uppm._kernels.camera import prepare_depth\nfrom .pool import Pool"),
        ("perception/masks/new.py", "from ..registry import create_segmenter\nfrom uppm.core import types"),
        ("cli/new.py", "import uppm.pipeline, uppm.evaluation.geometry"),
    ):
        assert violations(SOURCE / "uppm" / file, text) == []


def test_import_is_light() -> None:
    """`import uppm` under 0.3 s is one rule of the house; what would break it is one of these modules."""
    code = "import sys, uppm; print(*{name.partition('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "uppm" in loaded
    assert HEAVY & set(loaded) == set()


def test_import_takes_little_processor_time() -> None:
    code = "import time; t = time.process_time(); import uppm; print(time.process_time() - t)"
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(5)]
    # Processor time, and the least of five, since the machine that tests may be busy with other things.
    assert min(float(run.stdout) for run in runs) < 0.3
