"""The shape of the source tree, as docs/architecture.md draws it: layers, headers that compile alone, and sizes."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "core"
PACKAGE = ROOT / "src" / "destello"

# A folder may use folders of lower layers and itself; folders of one layer never use each other.
CORE_LAYERS = {
    "base": 0,
    "texture": 1,
    "bsdf": 2,
    "shape": 2,
    "medium": 2,
    "light": 3,
    "camera": 3,
    "accel": 3,
    "scene": 4,
    "film": 4,
    "integrate": 5,
    "backend": 6,
}
BINDINGS_LAYER = 7
# Modules that stand directly in the package are one layer, 8. The facade and the command line show all that is below.
PACKAGE_LAYERS = {"io": 9, "scenes": 9, "viewer": 10, "dist": 10, "cli": 11, "__main__": 12, "__init__": 12}
MODULE_LAYER = 8

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60
# Tables of numbers or names, which no reader reads; and nothing else.
LONG_FILES = {f"core/bsdf/openpbr/{name}.h" for name in ("tables", "loss_tables", "film_tables")}
TABLES = ("facet", "stretched", "stretched_reflected_mean", "fuzz", "reflected_mean", "coupling")
LOSS_TABLES = ("loss_word", "stretched_loss_word", "loss_curve_word", "stretched_loss_curve_word")
LOSS_TABLES += ("loss_mean_entry", "stretched_loss_mean_entry")
FILM_TABLES = ("strata", "stretched_strata", "mean_strata", "stretched_mean_strata")
LONG_FUNCTIONS = {
    *(f"core/bsdf/ggx_albedo_table.h:ggx_albedo_{table}" for table in "ab"),
    *(f"core/bsdf/openpbr/tables.h:{table}_entry" for table in TABLES),
    *(f"core/bsdf/openpbr/loss_tables.h:{table}" for table in LOSS_TABLES),
    *(f"core/bsdf/openpbr/film_tables.h:{table}_entry" for table in FILM_TABLES),
}

COMPILER = os.environ.get("CXX") or shutil.which("g++") or shutil.which("clang++")


def sources(folder: Path, *suffixes: str) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.suffix in suffixes and "__pycache__" not in p.parts)


def core_sources() -> list[Path]:
    return sources(CORE, ".h", ".cpp", ".cu", ".cuh")


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def without_comments(text: str) -> str:
    """C++ text with comments and the contents of literals blanked; line breaks stay."""

    def blank(match: re.Match[str]) -> str:
        found = match.group()
        return re.sub(r"[^\n]", " ", found) if found.startswith("/") else '""' + "\n" * found.count("\n")

    raw = r'R"(?P<tag>[^()\s\\]{0,16})\((?:.|\n)*?\)(?P=tag)"'
    return re.sub(rf"{raw}|//[^\n]*|/\*(?:.|\n)*?\*/|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])'", blank, text)


# --- who may use whom -------------------------------------------------------------------------------------------------
def test_every_core_folder_has_a_layer() -> None:
    assert {p.name for p in CORE.iterdir() if p.is_dir()} <= set(CORE_LAYERS)
    assert not [p.name for p in CORE.iterdir() if p.is_file()], "sources belong in a layer's folder"


def test_core_includes_lower_layers_only() -> None:
    wrong = []
    for path in core_sources():
        own = path.relative_to(CORE).parts[0]
        for line, include in quoted_includes(path):
            target = include.split("/")[0]
            if not (CORE / include).is_file():
                wrong.append(f"{name_of(path)}:{line}: {include} is not a path below core/")
            elif target != own and CORE_LAYERS[target] >= CORE_LAYERS[own]:
                wrong.append(
                    f"{name_of(path)}:{line}: {own} (L{CORE_LAYERS[own]}) uses {include} (L{CORE_LAYERS[target]})"
                )
    assert not wrong, "\n".join(wrong)


def quoted_includes(path: Path) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if match := re.match(r'\s*#\s*include\s*"([^"]+)"', line):
            yield number, match.group(1)


def test_core_knows_no_python() -> None:
    wrong = [
        f"{name_of(path)}:{number}: {line.strip()}"
        for path in core_sources()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.match(r"\s*#\s*include\s*[<\"](Python\.h|nanobind/|bindings/)", line)
    ]
    assert not wrong, "\n".join(wrong)


def test_headers_are_guarded_by_pragma_once() -> None:
    headers = sources(CORE, ".h", ".cuh") + sources(ROOT / "bindings", ".h")
    wrong = [name_of(p) for p in headers if "#pragma once" not in p.read_text(encoding="utf-8")]
    assert not wrong


def test_only_defs_and_the_backends_look_at_the_compiler() -> None:
    wrong = []
    for path in core_sources():
        if (
            path == CORE / "base" / "defs.h"
            or path.relative_to(CORE).parts[0] == "backend"
            or path.suffix in {".cu", ".cuh"}
        ):
            continue
        for number, line in enumerate(without_comments(path.read_text(encoding="utf-8")).splitlines(), 1):
            if re.search(r"__CUDACC__|__CUDA_ARCH__|__NVCC__|__host__|__device__|__global__", line):
                wrong.append(f"{name_of(path)}:{number}: {line.strip()}")
    assert not wrong, "\n".join(wrong)


def layer_of_module(parts: tuple[str, ...]) -> tuple[int, str]:
    """Layer and folder of `destello.<parts>`; the folder of a module that stands in the package itself is ''."""
    head = parts[0] if parts else "__init__"
    if head == "_core":
        return BINDINGS_LAYER, "_core"
    return (PACKAGE_LAYERS[head], head) if head in PACKAGE_LAYERS else (MODULE_LAYER, "")


def imports_of(path: Path) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Line and dotted path below `destello` of each import from the package, but for those only type checkers see."""
    own = path.relative_to(PACKAGE).with_suffix("").parts
    package = own[:-1]
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    for node in walk_without_type_checking(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                parts = alias.name.split(".")
                if parts[0] == "destello" and len(parts) > 1:
                    yield node.lineno, tuple(parts[1:])
        elif isinstance(node, ast.ImportFrom):
            module = tuple((node.module or "").split(".")) if node.module else ()
            if node.level:
                base = package[: len(package) - (node.level - 1)] + module
            elif module[0] == "destello":
                base = module[1:]
            else:
                continue
            for alias in node.names:  # `from destello import x`: x is a module, or something the facade gives
                yield node.lineno, base or (alias.name,)


def walk_without_type_checking(node: ast.AST) -> Iterator[ast.AST]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        yield child
        yield from walk_without_type_checking(child)


def test_package_imports_lower_layers_only() -> None:
    wrong = []
    for path in sources(PACKAGE, ".py"):
        own_layer, own_folder = layer_of_module(path.relative_to(PACKAGE).with_suffix("").parts)
        for line, parts in imports_of(path):
            layer, folder = layer_of_module(parts)
            if folder != own_folder and layer >= own_layer:
                wrong.append(f"{name_of(path)}:{line}: L{own_layer} imports destello.{'.'.join(parts)} (L{layer})")
    assert not wrong, "\n".join(wrong)


# --- every header can be the first one --------------------------------------------------------------------------------
def headers_for_the_host() -> list[str]:
    needs_toolkit = re.compile(r"#\s*include\s*<(cuda|cub/|thrust/|driver_types|vector_types)")
    headers = sources(CORE, ".h")
    return [name_of(p) for p in headers if not needs_toolkit.search(p.read_text(encoding="utf-8"))]


@pytest.mark.skipif(not COMPILER, reason="there is no C++ compiler")
@pytest.mark.parametrize("header", headers_for_the_host())
def test_header_compiles_alone(header: str) -> None:
    warnings = ["-Wall", "-Wextra", "-Werror", "-Wno-psabi", "-Wno-unknown-pragmas"]
    command = [str(COMPILER), "-std=c++20", "-fsyntax-only", *warnings, "-Icore"]
    text = f'#include "{header.removeprefix("core/")}"\n'
    done = subprocess.run([*command, "-xc++", "-"], input=text, cwd=ROOT, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


# --- sizes ------------------------------------------------------------------------------------------------------------
def our_sources() -> list[Path]:
    folders = [
        ROOT / name for name in ("bindings", "src", "tests", "tools", "benches", "examples") if (ROOT / name).is_dir()
    ]
    return core_sources() + [p for f in folders for p in sources(f, ".py", ".h", ".cpp", ".cu")]


def test_files_are_short() -> None:
    counts = {name_of(p): len(p.read_text(encoding="utf-8").splitlines()) for p in our_sources()}
    wrong = [f"{n}: {c} lines" for n, c in counts.items() if c > MAX_FILE_LINES and n not in LONG_FILES]
    assert not wrong, f"over {MAX_FILE_LINES} lines:\n" + "\n".join(wrong)


def test_functions_are_short() -> None:
    wrong = []
    for path in our_sources():
        found = python_functions(path) if path.suffix == ".py" else cpp_functions(path.read_text(encoding="utf-8"))
        for function, line, length in found:
            if length > MAX_FUNCTION_LINES and f"{name_of(path)}:{function}" not in LONG_FUNCTIONS:
                wrong.append(f"{name_of(path)}:{line}: {function}: {length} lines")
    assert not wrong, f"over {MAX_FUNCTION_LINES} lines:\n" + "\n".join(wrong)


def python_functions(path: Path) -> Iterator[tuple[str, int, int]]:
    """Name, line and number of lines of each function, its documentation not counted."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            doc = node.body[0] if ast.get_docstring(node) is not None else None
            doc_lines = (doc.end_lineno or doc.lineno) - doc.lineno + 1 if doc else 0
            yield node.name, node.lineno, (node.end_lineno or node.lineno) - node.lineno + 1 - doc_lines


NOT_A_FUNCTION = re.compile(r"^(namespace|extern|struct|class|union|enum|requires)\b|=\s*$")


def cpp_functions(text: str) -> Iterator[tuple[str, int, int]]:
    """The same for C++, by braces: a block after a parameter list is a function, unless it is inside of one."""
    text = re.sub(r"(?m)^\s*#.*(\\\n.*)*$", lambda m: "\n" * m.group().count("\n"), without_comments(text))
    stack: list[tuple[str, int, bool]] = []
    header_start, line = 0, 1
    for match in re.finditer(r"[{};\n]", text):
        mark = match.group()
        if mark == "\n":
            line += 1
            continue
        if mark == "{":
            header = text[header_start : match.start()].strip()
            header = re.sub(r"^(template\s*<[^{};]*?>\s*)", "", header)
            inside = any(is_function for _, _, is_function in stack)
            is_function = not inside and "(" in header and not NOT_A_FUNCTION.search(header)
            stack.append((header, line, is_function))
        elif mark == "}" and stack:
            header, start, is_function = stack.pop()
            if is_function:
                name = re.search(r"([\w~:]+|operator\S+)\s*\(", header)
                yield name.group(1) if name else "?", start, line - start + 1
        header_start = match.end()


def test_the_measure_of_cpp_functions() -> None:
    text = """namespace a {
struct B {
  int c(int d) const {
    if (d) {
      return 1;  // }
    }
    return "}"[0];
  }
};
}
"""
    assert list(cpp_functions(text)) == [("c", 3, 6)]
