"""Which functions, classes and methods a command or a route can reach, read from the text of the code.

Whatever is not a definition runs when its module is imported and counts as reached; so do definitions with a
decorator that hands them to somebody: a route, a command, a validator. From there names lead on, a plain name
to what the module defines or imports, an attribute to every method of that name in a reached class. An import
alone leads nowhere. So nothing that is reached is missed, and a little that is not may pass for it.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
Function = (ast.FunctionDef, ast.AsyncFunctionDef)
Key = tuple[str, str, str]
"""The module, the function or class in it, and the method, "" for none."""

HANDS_TO_NOBODY = frozenset(
    {
        "abstractmethod",
        "cache",
        "classmethod",
        "contextmanager",
        "dataclass",
        "final",
        "inlined",
        "kernel",
        "lru_cache",
        "overload",
        "override",
        "property",
        "runtime_checkable",
        "staticmethod",
    }
)


def modules_below(root: Path, packages: Iterable[str]) -> dict[str, ast.Module]:
    """Return the modules of the packages by their names."""
    found = {}
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(part for part in parts if part != "__init__")
            found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def unreached(modules: Mapping[str, ast.Module], entries: Iterable[tuple[str, str]]) -> list[str]:
    """Return what no ``entries`` (module, function) lead to, as ``module.name`` or ``module.Class.name``."""
    search = _Search(modules)
    for module, tree in modules.items():
        search.visit(module, [node for node in tree.body if not isinstance(node, Definition | ast.Import)])
    for module, name in entries:
        search.push((module, name, ""))
    search.push_all(key for key, node in search.defined.items() if not key[2] and _is_handed_on(node))
    search.run()
    return [".".join(filter(None, key)) for key in search.defined if search.is_missing(key)]


class _Search:
    def __init__(self, modules: Mapping[str, ast.Module]) -> None:
        self.defined: dict[Key, Definition] = {}
        self._modules = modules
        self._imports = {module: dict(_imports(tree)) for module, tree in modules.items()}
        self._methods: dict[str, list[Key]] = {}
        for module, tree in modules.items():
            for node in tree.body:
                if isinstance(node, Definition):
                    self.defined[module, node.name, ""] = node
                if isinstance(node, ast.ClassDef):
                    for method in filter(lambda each: isinstance(each, Function), node.body):
                        key = (module, node.name, method.name)
                        self.defined[key] = method
                        self._methods.setdefault(method.name, []).append(key)
        self._reached = set[Key]()
        self._attributes = set[str]()
        self._waiting: list[Key] = []

    def is_missing(self, key: Key) -> bool:
        """Methods of what is missing as a whole are not told one by one."""
        return key not in self._reached and (not key[2] or (*key[:2], "") in self._reached)

    def push(self, key: Key) -> None:
        owner = (*key[:2], "")
        if key in self.defined and key not in self._reached and (not key[2] or owner in self._reached):
            self._reached.add(key)
            self._waiting.append(key)

    def push_all(self, keys: Iterable[Key]) -> None:
        for key in keys:
            self.push(key)

    def run(self) -> None:
        while self._waiting:
            key = self._waiting.pop()
            node = self.defined[key]
            if not isinstance(node, ast.ClassDef):
                self.visit(key[0], [node])
                continue
            rest = [each for each in node.body if not isinstance(each, Function)]
            self.visit(key[0], [*node.bases, *node.keywords, *node.decorator_list, *rest])
            for method in filter(lambda each: isinstance(each, Function), node.body):
                is_special = method.name.startswith("__")
                if is_special or method.name in self._attributes or _is_handed_on(method):
                    self.push((key[0], node.name, method.name))

    def visit(self, module: str, nodes: Iterable[ast.AST]) -> None:
        for node in (each for top in nodes for each in ast.walk(top)):
            if isinstance(node, ast.Name):
                self.push_all(self._named(module, node.id))
            elif isinstance(node, ast.Attribute):
                self._follow(module, node)

    def _follow(self, module: str, node: ast.Attribute) -> None:
        if isinstance(node.value, ast.Name):
            origin = self._imports[module].get(node.value.id)
            if origin is not None and (whole := ".".join(filter(None, origin))) in self._modules:
                self.push_all(self._named(whole, node.attr))
                return
        self._attributes.add(node.attr)
        self.push_all(self._methods.get(node.attr, ()))

    def _named(self, module: str, name: str) -> Iterator[Key]:
        """Yield the definition that a plain name stands for, if it is ours."""
        while (module, name, "") not in self.defined:
            origin = self._imports.get(module, {}).get(name)
            if origin is None or origin[0] not in self._modules:
                return
            module, name = origin
        yield module, name, ""


def _imports(tree: ast.Module) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield each imported name with its module and its name there, "" for a module as a whole."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                yield alias.asname or alias.name, (node.module, alias.name)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.asname or alias.name, (alias.name, "")


def _is_handed_on(node: Definition) -> bool:
    return any(_name_of(decorator) not in HANDS_TO_NOBODY for decorator in node.decorator_list)


def _name_of(decorator: ast.expr) -> str:
    if isinstance(decorator, ast.Call):
        return _name_of(decorator.func)
    return decorator.attr if isinstance(decorator, ast.Attribute) else ast.unparse(decorator)
