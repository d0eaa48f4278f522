"""The Khronos glTF validator, run by node."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PACKAGE = Path(sys.prefix) / "gltf" / "node_modules" / "gltf-validator"
PROGRAM = """
const validator = require(process.argv[1]);
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[2]));
validator.validateBytes(bytes).then((report) => console.log(JSON.stringify(report)));
"""


def validate(file: Path) -> dict[str, Any]:
    """The validator's report on a GLB file; the test is skipped, and says so, where there is no validator."""
    node = shutil.which("node")
    if node is None or not PACKAGE.is_dir():
        pytest.skip(f"needs {'node' if node is None else 'the Khronos glTF validator'}: `make .venv/.gltf`, with npm")
    command = [node, "-e", PROGRAM, str(PACKAGE), str(file)]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout)


def assert_valid(file: Path) -> dict[str, Any]:
    """No error, no warning, and nothing else that the validator has to say; returns its account of the contents."""
    report = validate(file)
    assert report["issues"]["messages"] == []
    return report["info"]
