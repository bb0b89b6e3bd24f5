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


def parameters(source: Path) -> dict[str, tuple[set[str], float]]:
    """Parameters, and number of those by position, of functions without `**` and without a decorator."""
    own = dict[str, tuple[set[str], float]]()
    for node in ast.parse(source.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and not node.decorator_list and not node.args.kwarg:
            most = float("inf") if node.args.vararg else len(node.args.args)
            own[node.name] = {a.arg for a in (*node.args.args, *node.args.kwonlyargs)}, most
    return own


def unknown_arguments(root: Path) -> set[str]:
    """Arguments in calls of functions of these packages that the function does not have."""
    of_module, wrong = dict[Path, dict[str, tuple[set[str], float]]](), set[str]()

    def signatures(source: Path) -> dict[str, tuple[set[str], float]]:
        if source not in of_module:
            of_module[source] = parameters(source) if source.exists() else {}
        return of_module[source]

    for path in sorted(p for p in root.rglob("*.py") if not {".venv", "build"} & set(p.parts)):
        tree, known = ast.parse(path.read_text(encoding="utf-8")), dict(signatures(path))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OWN:
                there = signatures(source_of(root, node.module or ""))
                known |= {a.asname or a.name: there[a.name] for a in node.names if a.name in there}
        for name in bound(tree) - set(signatures(path)):
            known.pop(name, None)
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            names, most = known.get(called := node.func.id, (set[str](), float("inf")))
            given = {f"{k.arg}=..." for k in node.keywords if k.arg and called in known}
            given -= {f"{name}=..." for name in names}
            if sum(not isinstance(a, ast.Starred) for a in node.args) > most:
                given.add(f"{len(node.args)} arguments")
            here = path.relative_to(root).as_posix()
            wrong |= {f"{here}: {called}({what})" for what in given}
    return wrong


def test_every_keyword_is_one_of_the_function(root: Path) -> None:
    """A study called a function with a parameter that was gone, after a quarter of an hour."""
    assert not unknown_arguments(root)


def test_a_keyword_of_nothing_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "emgface").mkdir()
    (tmp_path / "emgface" / "one.py").write_text("def here(a, *, b=1): ...\n")
    text = "from emgface.one import here as there\nthere(a=1, b=2)\nthere(1, c=3)\nthere(1, 2)\n"
    (tmp_path / "emgface" / "two.py").write_text(text)
    expected = {"emgface/two.py: there(c=...)", "emgface/two.py: there(2 arguments)"}
    assert unknown_arguments(tmp_path) == expected


WITHOUT_MEANING = {"found", "told", "held", "beside", "of"}
"""Names that do not say what is found, told, held or meant."""


def bound(tree: ast.AST) -> set[str]:
    """Names that a module binds: functions, classes, parameters and variables."""
    names = set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


def empty_names(text: str) -> set[str]:
    """Names of a module that say nothing by themselves."""
    return {n for n in bound(ast.parse(text)) if n.strip("_").lower() in WITHOUT_MEANING}


def test_names_say_what_they_are(root: Path) -> None:
    """A variable is named for what it contains, a function for what it computes."""
    paths = [p for name in (*OWN, "docs") for p in sorted((root / name).rglob("*.py"))]
    assert len(paths) > 1000
    texts = {p.relative_to(root).as_posix(): p.read_text(encoding="utf-8") for p in paths}
    assert not {name: names for name, text in texts.items() if (names := empty_names(text))}
    assert not [name for name in texts if Path(name).stem.strip("_") in WITHOUT_MEANING]


def test_an_empty_name_is_noticed() -> None:
    assert empty_names("def _of(held):\n    found = held\n") == {"_of", "held", "found"}
    assert empty_names("class Told:\n    found_faces = 1\n") == {"Told"}


SHARED_BY_REGISTRY = {
    "FORMAT": ("emgface/recordings/readers",),
    "SUFFIXES": ("emgface/recordings/readers", "emgface/recordings/exports"),
    "NAME": ("emgface/recordings/exports",),
}
"""Constants that every module of a registry defines, and the folders of these modules."""


def constants(root: Path, packages: tuple[str, ...]) -> dict[str, set[tuple[str, str]]]:
    """Modules of packages that define each public constant, with the expression of its value."""
    places = defaultdict[str, set[tuple[str, str]]](set)
    for path in sorted(p for package in packages for p in (root / package).rglob("*.py")):
        here = path.relative_to(root).as_posix()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.AnnAssign):
                targets = [node.target]
            elif isinstance(node, ast.Assign):
                targets = node.targets
            else:
                continue
            value = node.value
            for target in targets if value is not None else []:
                pairs = [(target, value)]
                if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                    pairs = list(zip(target.elts, value.elts, strict=True))
                for name, one in pairs:
                    if not (isinstance(name, ast.Name) and name.id.isupper()):
                        continue
                    if name.id[0] == "_" or here.startswith(
                        SHARED_BY_REGISTRY.get(name.id, ("-",))
                    ):
                        continue
                    if isinstance(one, ast.Call) and ast.unparse(one.func).endswith(TYPES):
                        continue
                    places[name.id].add((here, ast.unparse(one)))
    return places


TYPES = ("TypeVar", "ParamSpec")
"""Names of types are no constants; type checkers require them in the module that uses them."""


def test_constants_of_the_mechanics_have_one_value(root: Path) -> None:
    """A constant that a second module needs too has the same value there, and the same meaning."""
    every = constants(root, ("sim",))
    assert len(every) > 200
    assert not {n: p for n, p in every.items() if len({value for _, value in p}) > 1}


def test_constants_of_the_face_and_the_analysis_have_one_module(root: Path) -> None:
    """The name says what the number bounds; who needs the same number imports it."""
    every = constants(root, ("emgface", "analysis"))
    assert len(every) > 1000
    assert not {name: places for name, places in every.items() if len(places) > 1}


def test_a_constant_with_two_values_is_noticed(tmp_path: Path) -> None:
    for package, text in (
        ("sim", "MOST, LEAST = 1, 2\nT = TypeVar('T')\n"),
        ("emgface", "MOST: Final = 3\nFORMAT = 1\n"),
    ):
        (tmp_path / package).mkdir()
        (tmp_path / package / "one.py").write_text(text)
    every = constants(tmp_path, ("sim", "emgface"))
    assert {value for _, value in every["MOST"]} == {"1", "3"}
    assert set(every) == {"MOST", "LEAST", "FORMAT"} and len(every["LEAST"]) == 1
