"""Kernels are declared in one way, and stand apart from all but the module that checks their arguments."""

from __future__ import annotations

import ast
import importlib
from functools import cache
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import lrtrav_ros

PACKAGE = Path(lrtrav_ros.__file__).parent
KERNELS = sorted(PACKAGE.rglob("_*_kernels.py"))


def module_name(path: Path) -> str:
    return ".".join(("lrtrav_ros", *path.relative_to(PACKAGE).with_suffix("").parts))


@cache
def imports(path: Path) -> set[str]:
    """Return the names of all modules, and of all that is taken from them, that a file imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def test_there_are_kernels() -> None:
    found = {path.stem for path in KERNELS}
    names = ("comparison", "delaunay", "elas", "extension", "features", "grid", "ground", "propagation", "raycasting")
    others = ("points", "refinement", "registration", "rvl", "segmentation", "slopes", "superpixels", "textures")
    assert found == {f"_{name}_kernels" for name in (*names, *others)}


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_kernels_are_imported_by_the_module_beside_them_alone(path: Path) -> None:
    users = [other for other in PACKAGE.rglob("*.py") if module_name(path) in imports(other)]
    assert users == [path.with_name(path.stem.removeprefix("_").removesuffix("_kernels") + ".py")]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_functions_of_kernel_modules_are_kernels(path: Path) -> None:
    module = importlib.import_module(module_name(path))
    own = [value for value in vars(module).values() if getattr(value, "__module__", "") == module.__name__]
    functions = [value for value in own if not (isinstance(value, type) and issubclass(value, tuple))]  # named tuples
    assert functions
    for function in functions:
        assert isinstance(function, Dispatcher)
        assert function.targetoptions["nogil"]
        assert function.targetoptions["error_model"] == "numpy"
        assert not {"return", *function.py_func.__code__.co_varnames[: function.py_func.__code__.co_argcount]} - set(
            function.py_func.__annotations__
        )


def test_numba_compiles_nowhere_else() -> None:
    users = {module_name(path) for path in PACKAGE.rglob("*.py") if "numba" in imports(path)}
    assert users == {"lrtrav_ros.numerics.kernels"}
