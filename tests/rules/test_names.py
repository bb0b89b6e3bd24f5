"""Names: each public one has one module, and every import names something that exists."""

import ast
from collections import defaultdict
from pathlib import Path

CONTRACTS = (
    "emgface/models",  # functions of a kind of model
    "emgface/recordings/readers",  # functions of a format
    "emgface/recordings/exports",
    "emgface/cli",  # commands, named for the functions that they call
    "emgface/api",
)
"""Folders whose modules define the same names."""


def homes(root: Path) -> dict[str, list[str]]:
    """Modules that define each public function or class."""
    modules_by_name = defaultdict[str, list[str]](list)
    for package in ("emgface", "analysis"):
        for path in sorted((root / package).rglob("*.py")):
            here = path.relative_to(root).as_posix()
            if here.startswith(CONTRACTS):
                continue
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_":
                    modules_by_name[node.name].append(here)
    return modules_by_name


def test_every_public_name_has_one_module(root: Path) -> None:
    """A reader who searches for a name finds one definition, and an import cannot be the wrong one."""
    every = homes(root)
    assert len(every) > 1000
    assert not {name: places for name, places in every.items() if len(places) > 1}


def test_a_name_with_two_modules_is_found(tmp_path: Path) -> None:
    for package in ("emgface", "analysis"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "one.py").write_text("def twice(): ...\ndef _own(): ...\n")
    assert homes(tmp_path) == {"twice": ["emgface/one.py", "analysis/one.py"]}


OWN = ("emgface", "sim", "analysis", "benchmarks", "studies", "tests")


def source_of(root: Path, module: str) -> Path:
    """File of a module or package."""
    place = root.joinpath(*module.split("."))
    package = place / "__init__.py"
    return package if package.exists() else place.with_suffix(".py")


def defined(source: Path) -> set[str]:
    """Names that a module defines or imports, and words of its strings if it loads some on request."""
    tree, names = ast.parse(source.read_text(encoding="utf-8")), set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
    if "__getattr__" in names:
        strings = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)]
        names |= {word for text in strings if isinstance(text, str) for word in text.split()}
    return names


def missing(root: Path) -> set[str]:
    """Imports from these packages, and attributes of their modules, that name nothing."""
    absent, names = set[str](), dict[Path, set[str]]()

    def has(module: str, name: str) -> bool:
        source = source_of(root, module)
        if source not in names:
            names[source] = defined(source) if source.exists() else set()
        return name in names[source] or source_of(root, f"{module}.{name}").exists()

    for path in sorted(p for p in root.rglob("*.py") if not {".venv", "build"} & set(p.parts)):
        modules, used = dict[str, str](), set[tuple[str, str]]()
        stored, attributes = set[str](), list[tuple[str, str]]()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                if node.module and node.module.split(".")[0] in OWN:
                    used |= {(node.module, alias.name) for alias in node.names}
                    for alias in node.names:
                        whole = f"{node.module}.{alias.name}"
                        if source_of(root, whole).exists():
                            modules[alias.asname or alias.name] = whole
            elif isinstance(node, ast.Name):
                if isinstance(node.ctx, ast.Store):
                    stored.add(node.id)
            elif isinstance(node, ast.arg):
                stored.add(node.arg)
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                attributes.append((node.value.id, node.attr))
        for name, attribute in attributes:
            if name in modules and name not in stored and attribute[:2] != "__":
                used.add((modules[name], attribute))
        here = path.relative_to(root).as_posix()
        absent |= {f"{here}: {module}.{name}" for module, name in used if not has(module, name)}
    return absent


def test_every_import_names_something_that_exists(root: Path) -> None:
    """No test executes the programs that draw the pictures, and their imports would break unseen."""
    assert not missing(root)


def test_a_name_of_nothing_is_found(tmp_path: Path) -> None:
    (tmp_path / "emgface").mkdir()
    (tmp_path / "emgface" / "__init__.py").write_text("")
    (tmp_path / "emgface" / "one.py").write_text("def here(): ...\n")
    text = (
        "from emgface.one import gone, here\nfrom emgface import one, two\none.here()\none.lost()\n"
    )
    (tmp_path / "make.py").write_text(text)
    wanted = {"emgface.one.gone", "emgface.one.lost", "emgface.two"}
    assert missing(tmp_path) == {f"make.py: {name}" for name in wanted}
