"""What `uppm` exports, and that each of it says what it is."""

from __future__ import annotations

import ast
import inspect
from importlib import import_module
from pathlib import Path

import pytest

import uppm

PACKAGE = Path(uppm.__file__).parent


@pytest.mark.parametrize("name", uppm.__all__)
def test_every_export_exists_and_is_documented(name: str) -> None:
    exported = getattr(uppm, name)
    assert exported.__name__ == name
    assert inspect.getdoc(exported)
    assert exported.__module__.startswith("uppm.")


def test_names_for_the_type_checker_are_the_exports() -> None:
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    imports = [
        node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and (node.module or "")[:5] == "uppm."
    ]
    declared = {alias.name: node.module for node in imports for alias in node.names}
    assert sorted(declared) == uppm.__all__ == dir(uppm)
    for name, module in declared.items():
        assert getattr(import_module(module or ""), name) is getattr(uppm, name)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Maper'"):
        _ = uppm.Maper  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("name", uppm.__all__)
def test_public_methods_are_documented(name: str) -> None:
    exported = getattr(uppm, name)
    own = vars(exported) if inspect.isclass(exported) else {}
    methods = {key: value for key, value in own.items() if inspect.isfunction(value) or isinstance(value, property)}
    assert [key for key, value in methods.items() if not key.startswith("_") and not inspect.getdoc(value)] == []


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_every_module_says_what_it_is(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
