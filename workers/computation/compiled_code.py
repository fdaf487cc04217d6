"""Code of kernels on disk: found by its content, from any folder, clone, environment or layer of an image.

The code of a kernel is good for one state of all sources that it reaches, of the values that it has frozen,
of Python, numba and the processor. Those are its address: what has changed is looked for elsewhere, and what
has not is found, whoever compiled it. Many versions may use a folder at once; nothing in it is changed.

Outside of the compiling task nothing compiles. Where code is missing, :class:`.ways.NotReadyError` is raised,
and jobs go the plain way. Tests look for kernels that no group has; one that is met all the same is compiled
where it is met, once all groups are complete.

Files are looked for here and not in the solvers, which are pure, and not in the worker process, since jobs
are also solved without one: by commands, calibrations and tests.

Processor and libraries are recorded with each solution too: where they are equal, equal problems give equal
bits. Sums, sines and matrix products of doubles are computed by other instructions on other processors, hence
rounded otherwise in their last bits. Which, the libraries choose by the features of a processor, not by its
model.
"""

import ctypes
import hashlib
import importlib
import importlib.util
import logging
import os
import platform
import re
import secrets
import shutil
import sys
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal  # Any: numba has no types

import numpy as np

from service.local.workers import own_folder
from service.versions import version_of
from workers.solvers import compiled, ways

logger = logging.getLogger(__name__)


LIBRARIES = ("numpy", "scipy", "numba", "python-flint")
HIDING_VARIABLES = ("NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "GLIBC_TUNABLES")
"""Environment variables that hide features of the processor from a library."""


@cache
def processor() -> str:
    """Return the architecture, the features that numpy dispatches on, and the kernels of its matrix products.

    What hides features from a library is told as it was set: the mathematical
    library of the platform and the compiler do not say what they found.
    """
    # NPY_DISABLE_CPU_FEATURES is seen in what is found.
    hidden = [f"{name}={os.environ[name]}" for name in HIDING_VARIABLES[1:] if os.environ.get(name)]
    features = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    kernels = _matrix_kernels()
    return " ".join([platform.machine(), *features, *([f"BLAS:{kernels}"] if kernels else []), *hidden])


@cache
def libraries() -> str:
    """Return the versions of what computes with doubles, Python and the platform's own library among it."""
    libc = " ".join(platform.libc_ver()) if platform.system() == "Linux" else platform.platform()
    named = [
        f"Python {platform.python_version()}",
        *(f"{name} {version_of(name)}" for name in LIBRARIES),
    ]
    return ", ".join([*named, libc])


def threads() -> int | None:
    """Return among how many threads a product of matrices may be divided; None if the library does not tell.

    All else is computed by one thread: kernels are compiled without parallel loops, and a job is one child.
    """
    library = _openblas()
    return None if library is None else int(library.scipy_openblas_get_num_threads64_())


def _matrix_kernels() -> str | None:
    """Return for which processor the OpenBLAS in numpy's wheel has chosen its kernels; None without it."""
    library = _openblas()
    if library is None:
        return None
    name = library.scipy_openblas_get_corename64_
    name.restype = ctypes.c_char_p
    core = name()
    return core.decode("ascii") if isinstance(core, bytes) else None


@cache
def _openblas() -> ctypes.CDLL | None:
    """Return the OpenBLAS in numpy's wheel, if it is there and has the functions that are asked here."""
    folder = Path(np.__file__).parents[1] / "numpy.libs"
    for file in sorted(folder.glob("libscipy_openblas*")):
        try:
            library = ctypes.CDLL(str(file))
        except OSError:
            continue
        if all(hasattr(library, f"scipy_openblas_get_{each}64_") for each in ("corename", "num_threads")):
            return library
    return None


WAY_VARIABLE = "POLHODE_WAY"
"""``compiled`` or ``plain``: the way of every job, whatever is ready. For tests."""
Group = Literal["planar", "outputs", "sweeps", "states"]
GROUPS: tuple[Group, ...] = ("planar", "outputs", "sweeps", "states")
"""Kernels that are needed together, in the order in which they are compiled."""
UNUSED_SECONDS = 30 * 86400.0
"""After so long code that no complete set has used is removed."""

_PACKAGE = compiled.__name__
_SHARED = "service.dynamics.equations.euler_poisson"
"""The module beside the package from which kernels are made."""
_IMPORTS = re.compile(
    rf"^from ({re.escape(_PACKAGE)}[\w.]*|{re.escape(_SHARED)}) import ".encode(), re.MULTILINE
)
_FROZEN_TYPES = (bool, int, float, complex, str, bytes, tuple, np.ndarray, np.generic, np.dtype)
"""Types of what kernels freeze."""


class _Compiling:
    """The permission of this process to compile. Only the compiling task changes it."""

    is_allowed = False


def allow_compiling() -> None:
    """Compile what is missing in this process."""
    _Compiling.is_allowed = True


@cache
def keep_compiled_code() -> None:
    """Have the code of kernels looked for, and kept; whoever calls them calls this before the first call."""
    ways.keep_by(_keep)


def _keep(kernel: Any) -> None:  # noqa: ANN401
    kernel.code = KernelCode(kernel.py_func)


class KernelCode:
    """The code of one kernel, for all types of its arguments: where :mod:`.compiled.kernels` keeps it."""

    def __init__(self, function: Any) -> None:  # noqa: ANN401
        self._function = function

    def load(self, kind: ways.Kind, types: object, context: Any) -> Any:  # noqa: ANN401
        """Return what was saved for arguments of these types; None has it compiled.

        Raises
        ------
        NotReadyError
            An entry is not there, and this process does not compile: as long as a group is not complete, or
            a setting fixes the way. Else no group has it, and nobody would ever compile it.
        """
        file = self._file(kind, types, context)
        code = None if file is None else file.load("code")
        if code is None and kind == "entry" and not _Compiling.is_allowed:
            self._tell_missing(types)
        return code

    def _tell_missing(self, types: object) -> None:
        if fixed_way() is not None or not is_ready(*GROUPS):
            raise ways.NotReadyError(f"{self._name} is not compiled for arguments of {types}")
        logger.warning("%s is in no group of kernels for these arguments; it is compiled now", self._name)

    def save(self, kind: ways.Kind, types: object, context: Any, saved: object) -> None:  # noqa: ANN401
        """Keep what was just compiled; without a folder it is for this process alone."""
        file = self._file(kind, types, context)
        if file is not None:
            Path(file._cache_path).mkdir(mode=0o700, exist_ok=True)
            file.save("code", saved)

    def first_number(self) -> int:
        """Return a number that no other process will get."""
        return secrets.randbits(60)

    @property
    def _name(self) -> str:
        return f"{self._function.__module__}.{self._function.__qualname__}"

    def _file(self, kind: ways.Kind, types: object, context: Any) -> Any:  # noqa: ANN401
        folder = own_folder()
        if folder is None:
            return None
        module = self._function.__module__
        # Not before the first call: a module that is still being loaded has not all of its values.
        stem = folder / f"{module.removeprefix(_PACKAGE + '.')}-{stamp(module)}"
        key = _digest([sys.implementation.cache_tag, repr(types), repr(context.codegen().magic_tuple())])
        # Written by rename, so that nobody reads half of it, and one file for one key: nothing is rewritten.
        return _numba("caching").IndexDataCacheFile(
            str(stem), f"{self._function.__qualname__}-{key}-{kind}", stem.name
        )


def _numba(part: str) -> Any:  # noqa: ANN401
    # Loaded by those who have kernels.
    return importlib.import_module(f"numba.core.{part}")


@cache
def stamp(module: str) -> str:
    """Return the digest of all that kernels of a module are made of.

    That is the sources of the module and of all that it imports from the package of kernels, or that these
    are made of, the values in them, which kernels freeze, wherever these come from, and the versions of the
    compiler.
    """
    parts = [version_of(each) for each in ("numba", "llvmlite", "numpy")]
    for name in sorted(reached(module)):
        loaded = importlib.import_module(name)
        parts += [name, hashlib.sha256(_source(name)).hexdigest()]
        values = {key: value for key, value in vars(loaded).items() if not key.startswith("__")}
        parts += [
            f"{key}={_in_words(value)}"
            for key, value in sorted(values.items())
            if isinstance(value, _FROZEN_TYPES)
        ]
    return _digest(parts)


def reached(module: str) -> frozenset[str]:
    """Return the modules of kernels whose sources are part of a module's code, itself among them."""
    names, left = set[str](), [module]
    while left:
        name = left.pop()
        if name not in names:
            names.add(name)
            left += [each.decode() for each in _IMPORTS.findall(_source(name))]
    return frozenset(names)


@cache
def _source(module: str) -> bytes:
    file = importlib.import_module(module).__file__
    return b"" if file is None else Path(file).read_bytes()


def _in_words(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    return repr(value)


def _digest(parts: Sequence[str]) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


_ready = set[Group]()
"""Groups that were ready once, and so stay ready: nothing is taken away from a folder in use."""


def is_ready(*groups: Group) -> bool:
    """Tell whether all code of these groups is in the folder, for this processor and these libraries."""
    for group in groups:
        if group not in _ready:
            note = note_of(group)
            if note is None or not note.exists():
                return False
            _ready.add(group)
    return True


def note_of(group: Group) -> Path | None:
    """Return the file that says that a group is complete; None without a folder."""
    folder = own_folder()
    return None if folder is None else folder / f"ready-{group}-{_here()}"


@cache
def _here() -> str:
    """Return a digest of everything that any kernel depends on, with the processor."""
    package = Path(compiled.__path__[0])
    sources = [
        f"{source.relative_to(package).as_posix()}={hashlib.sha256(source.read_bytes()).hexdigest()}"
        for source in sorted(package.rglob("*.py"))
    ] + [hashlib.sha256(_source(_SHARED)).hexdigest()]
    return _digest([version_of("llvmlite"), processor(), libraries(), *sources])


def take_shipped_code() -> None:
    """Copy into the folder what it lacks of the code that the package of ``make compiled-wheel`` ships."""
    spec, folder = importlib.util.find_spec("polhode_compiled"), own_folder()
    if spec is None or folder is None:
        return
    for package in spec.submodule_search_locations or ():
        # What says that a group is complete comes last, and nothing is seen by half.
        for source in [*Path(package).rglob("*.nb[ci]"), *Path(package).rglob("ready-*")]:
            target = folder / source.relative_to(Path(package, "compiled"))
            if not target.exists():
                target.parent.mkdir(mode=0o700, exist_ok=True)
                part = target.with_name(f"{target.name}.{os.getpid()}")
                shutil.copyfile(source, part)
                part.replace(target)


def fixed_way() -> ways.Way | None:
    """Return the way that the setting fixes for every job."""
    match os.environ.get(WAY_VARIABLE):
        case "compiled" | "plain" as way:
            return way
    return None


def way_for(*groups: Group) -> ways.Way:
    """Return the way of a job that needs these groups of kernels."""
    return fixed_way() or ("compiled" if is_ready(*groups) else "plain")


def code_in_use() -> list[Path]:
    """Return the folders of all modules of kernels that are loaded here."""
    folder = own_folder()
    if folder is None:
        return []
    modules = [name for name in sorted(sys.modules) if name.startswith(_PACKAGE + ".")]
    return [folder / f"{name.removeprefix(_PACKAGE + '.')}-{stamp(name)}" for name in modules]


def trim(used: Sequence[Path], *, unused_seconds: float = UNUSED_SECONDS) -> None:
    """Remove code that no complete set has used for long. ``used`` is what the latest one uses."""
    folder = own_folder()
    if folder is None or not os.access(folder, os.W_OK):
        return
    now = time.time()
    for each in used:
        if each.is_dir():
            os.utime(each)
    # Beside it lie the folders of versions that had one for each state of all sources.
    for each in [*folder.iterdir(), *folder.parent.glob("compiled-*")]:
        if each not in used and now - each.stat().st_mtime > unused_seconds:
            if each.is_dir():
                shutil.rmtree(each, ignore_errors=True)
            elif each.name.startswith("ready-"):
                each.unlink(missing_ok=True)
