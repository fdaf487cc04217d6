"""Kernels: functions compiled by numba, and machine code for what Python calls, linked and optimised once.

numba itself makes machine code of every function, and optimises it again inside each one that calls it, and
inside whatever calls that one. Here a function is translated once and waits as a *part*. Only an *entry*,
which Python calls, is optimised and becomes machine code, with its parts inside.

Names of functions end in numbers that one process counts. Parts that were kept know each other by the names
of their kernels and the types of arguments. :mod:`workers.solvers.ways` is told of each kernel, so that its
code is kept.
"""

import copy
import importlib
import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Protocol, TypeVar, cast  # Any: numba has no types

from llvmlite import binding
from numba.core import config, types
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompileResult, Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import Environment, lookup_environment
from numba.core.event import trigger_event
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys
from numba.core.sigutils import normalize_signature
from numba.core.targetconfig import ConfigStack
from numba.core.types import unliteral
from numba.extending import intrinsic

from workers.solvers import ways
from workers.solvers.ways import Code, Nowhere

# Here numba is extended, which has types for little of what that needs.
# mypy: disable-error-code="no-untyped-call, attr-defined"

F = TypeVar("F", bound=Callable[..., object])


class _Part(JITCodeLibrary):  # type: ignore[misc,unused-ignore]
    """The instructions of one function, as they were translated, unless it is an entry."""

    entry: str | None = None
    """The name of what Python calls."""
    origin: "tuple[Kernel, tuple[Any, ...], str] | None" = None
    """The kernel, the types of its arguments, and the name of the function; None for functions of numba."""

    def _ensure_finalized(self) -> None:
        # Whoever calls a part asks this first; it is finished with the entries that reach it.
        if self.entry is not None:
            super()._ensure_finalized()

    def get_pointer_to_function(self, name: str) -> int:
        """Return where a function begins that Python calls, which makes an entry of it; 0 without one."""
        if self.entry is None and any(each.name == name for each in self._final_module.functions):
            self.entry = name
        found: int = super().get_pointer_to_function(name)
        return found

    def finalize(self) -> None:
        """Link all that is reached, each once, optimise the whole, and make machine code."""
        self._linking_libraries = _reached(self, lambda _: True)
        super().finalize()

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """Return the machine code, beside the names in it: nothing is linked with an entry."""
        self._ensure_finalized()
        found = [f'define void @"{self.entry}"() {{ ret void }}']
        found += [f'@"{name}" = common global ptr null' for name in _environments(self._final_module)]
        names = binding.parse_assembly("\n".join(found)).as_bitcode()
        return self.name, "object", (self._get_compiled_object(), names)


LEVELS = {
    "x86-64-v2": {"cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"},
    "x86-64-v3": {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"},
    "x86-64-v4": {"avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"},
}
"""Features of each level beyond those of the one before it (x86-64 ABI, 3.1.1), in the words of LLVM."""


def level(features: str) -> str | None:
    """Return the highest level that a processor has, which compilers know by this name; None if it has none.

    ``features`` are as LLVM lists them, such as ``+avx2,-avx512f``.
    """
    has = {each[1:] for each in features.split(",") if each.startswith("+")}
    return max(itertools.takewhile(lambda name: LEVELS[name] <= has, LEVELS), default=None)


class _Codegen(JITCPUCodegen):  # type: ignore[misc,unused-ignore]
    """Makes parts, for all processors that have the level of this one; for its model alone without levels.

    What numba's settings say of the processor is obeyed.
    """

    _library_class = _Part

    def _get_host_cpu_name(self) -> str:
        named: str = super()._get_host_cpu_name()
        return named if config.CPU_NAME else level(super()._get_host_cpu_features()) or named

    def _get_host_cpu_features(self) -> str:
        features: str = super()._get_host_cpu_features()
        # A level has its features by its name.
        return "" if level(features) and config.CPU_FEATURES is None else features

    def set_env(self, name: str, environment: object) -> None:
        """Tell a function what it needs to know of Python, if it is in machine code."""
        if self._engine.is_symbol_defined(name):
            super().set_env(name, environment)


def _reached(library: Any, follows: Callable[[_Part], bool]) -> list[Any]:  # noqa: ANN401
    """Return what is linked with a part, and with that, if one ``follows`` it; each once, after its callers.

    The order matters: what nothing has called yet is left out when it is linked.
    """
    found = dict[Any, None]()

    def visit(part: Any) -> None:  # noqa: ANN401
        for each in part._linking_libraries:
            if each not in found:
                if isinstance(each, _Part) and not each._finalized and follows(each):
                    visit(each)
                found[each] = None

    visit(library)
    return list(found)[::-1]


class _Translation:
    """Number of functions that are being translated: what these ask for are parts. numba's lock guards it."""

    depth = 0


class Kernel(CPUDispatcher):  # type: ignore[misc,unused-ignore]
    """A function that is compiled for the types of its arguments: called by Python an entry, else a part."""

    _all: "dict[str, Kernel]" = {}  # noqa: RUF012  # by their names

    def __init__(self, function: Any, *, is_inlined: bool = False) -> None:  # noqa: ANN401
        # Division by zero gives inf or NaN; only entries are called by Python, and none by C.
        super().__init__(
            function,
            targetoptions={
                "nopython": True,
                "error_model": "numpy",
                "boundscheck": None,
                "forceinline": is_inlined,
                "no_cpython_wrapper": True,
                "no_cfunc_wrapper": True,
            },
        )
        self.code: Code = Nowhere()
        self.name = f"{function.__module__}.{function.__qualname__}"
        self._entries = dict[Any, Any]()
        self._all[self.name] = self

    def get_call_template(self, args: Any, kws: Any) -> Any:  # noqa: ANN401
        """Return numba's template for a call: a constant is a number like any other, one part for all."""
        numbers = {name: unliteral(each) for name, each in kws.items()}
        return super().get_call_template(tuple(unliteral(each) for each in args), numbers)

    def compile(self, types: object) -> Any:  # noqa: ANN401
        """Return what Python calls for arguments of these types; what stands for it inside another kernel."""
        with global_compiler_lock:
            arguments = tuple(normalize_signature(types)[0])
            if _Translation.depth:
                return self.part(arguments).entry_point
            if arguments not in self._entries:
                # Else nothing can be loaded into it.
                self.targetctx.refresh()
                _make_parts(self.targetctx, self.code.first_number)
                self._entries[arguments] = entry = self._entry(arguments)
                self._insert([each._code for each in arguments], entry.entry_point, False)
            return self._entries[arguments].entry_point

    def _entry(self, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401
        kept = self.code.load("entry", arguments, self.targetctx)
        if kept is not None:
            self._cache_hits[arguments] += 1
            return CompileResult._rebuild(self.targetctx, *kept)
        self._cache_misses[arguments] += 1
        part = self.part(arguments)
        with trigger_event("numba:compile", data={"dispatcher": self, "args": arguments, "kind": "entry"}):
            found = self._linked(part)
        # Seen twice, in children under load: LLVM had not handed the machine code over. Then the entry is for
        # this process alone.
        with suppress(RuntimeError):
            self.code.save("entry", arguments, self.targetctx, found._reduce())
        return found

    def _linked(self, part: Any) -> Any:  # noqa: ANN401
        # Arrays have owners that are counted, as in the part.
        context, flags = self.targetctx.subtarget(enable_nrt=True), Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        description = copy.copy(part.fndesc)
        # What the wrapper knows of Python is not mixed with what other entries know of the part.
        description.env_name += "_entry"
        environment = Environment.from_fndesc(description)
        library = context.codegen().create_library(description.mangled_name)
        library.enable_object_caching()
        library.add_linking_library(part.library)
        with ConfigStack().enter(flags):
            context.create_cpython_wrapper(
                library, description, environment, part.call_helper, release_gil=True
            )
        called = context.get_executable(library, description, environment)
        for name in _environments(library._final_module):
            known = lookup_environment(name)
            if known is not None:
                context.codegen().set_env(name, known)
        return part._replace(
            entry_point=called,
            library=library,
            fndesc=description,
            environment=environment,
            reload_init=list(library._reload_init),
        )

    def part(self, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401
        """Return what numba knows of the function for arguments of these types, without machine code."""
        if arguments not in self.overloads:
            kept = self.code.load("part", arguments, self.targetctx)
            found = self._translated(arguments) if kept is None else self._rebuilt_part(*kept)
            found.library.origin = self, arguments, found.fndesc.mangled_name
            self.overloads[arguments] = found
            if kept is None:
                self.code.save("part", arguments, self.targetctx, _reduced_part(found))
        return self.overloads[arguments]

    def _translated(self, arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401
        with (
            trigger_event("numba:compile", data={"dispatcher": self, "args": arguments, "kind": "part"}),
            self._compiling_counter,
        ):
            _Translation.depth += 1
            try:
                return self._compiler.compile(arguments, None)
            finally:
                _Translation.depth -= 1

    def _rebuilt_part(self, name: str, code: bytes, links: Any, described: Any, known: Any) -> Any:  # noqa: ANN401
        """Return a part that was saved: its library, what it calls, what numba knows of it and of Python."""
        context = self.targetctx
        library = context.codegen().create_library(name)
        library._final_module = module = binding.parse_bitcode(code)
        for kernel, arguments, function in links:
            importlib.import_module(kernel[0])
            called = self._all[kernel[1]].part(arguments)
            module.get_function(function).name = called.fndesc.mangled_name
            library.add_linking_library(called.library)
        library.add_linking_library(rtsys.library)
        description, signature, reload_init = described
        for run in reload_init:
            run()
        library._reload_init.update(reload_init)
        stands = context.get_executable(library, description, known[0])
        context.insert_user_function(stands, description, [library])
        return CompileResult(
            **dict[str, Any].fromkeys(CompileResult._fields)
            | {
                "typing_context": context.typing_context,
                "target_context": context,
                "entry_point": stands,
                "signature": signature,
                "objectmode": False,
                "lifted": (),
                "fndesc": description,
                "library": library,
                "environment": known[0],
                "reload_init": reload_init,
                "referenced_envs": known,
            }
        )


def _reduced_part(part: Any) -> tuple[object, ...]:  # noqa: ANN401
    """Return what :meth:`Kernel._rebuilt_part` takes: with functions of numba inside, without kernels."""
    library, links = part.library, list[Any]()
    module = library._final_module.clone()
    for each in _reached(library, lambda reached: reached.origin is None):
        origin = getattr(each, "origin", None)
        if origin is not None:
            links.append(origin)
        elif each is not rtsys.library:
            module.link_in(each._get_module_for_linking(), preserve=True)
    called = {each.name for each in module.functions}
    names = [
        ((kernel.py_func.__module__, kernel.name), arguments, function)
        for kernel, arguments, function in links
        if function in called
    ]
    environments = [lookup_environment(name) for name in _environments(module)]
    known = [part.environment, *(each for each in environments if each is not None and each.can_cache())]
    description = part.fndesc
    # As numba does: they may not be kept, and nobody needs them.
    description.typemap = description.calltypes = None
    return library.name, module.as_bitcode(), names, (description, part.signature, part.reload_init), known


def _environments(module: Any) -> list[str]:  # noqa: ANN401
    """Return the names of what functions know of Python."""
    names = [each.name for each in module.global_variables if not each.is_declaration]
    return [name for name in names if name.startswith("_ZN08NumbaEnv")]


def _make_parts(context: Any, first_number: Callable[[], int]) -> None:  # noqa: ANN401
    """Have numba make parts from now on, with names of functions that no other process gives."""
    if not isinstance(context.codegen(), _Codegen):
        context._internal_codegen = _Codegen("kernels")
        FunctionIdentity._unique_ids = itertools.count(first_number())


def kernel(function: F) -> F:
    """Compile ``function`` at its first call; division by zero gives inf or NaN, sums keep their order."""
    compiled = Kernel(function)
    ways.made(compiled)
    return cast("F", compiled)


def inlined(function: F) -> F:
    """Put ``function`` into the kernels that call it, which loops over several numbers at once need."""
    compiled = Kernel(function, is_inlined=True)
    ways.made(compiled)
    return cast("F", compiled)


class _Builder(Protocol):
    """The part of llvmlite's builder of instructions that is used."""

    def fma(self, a: object, b: object, c: object) -> object: ...


def _fused(_: object, __: object, ___: object, ____: object) -> tuple[object, object]:
    def build(_: object, builder: _Builder, __: object, operands: Sequence[object]) -> object:
        a, b, c = operands
        return builder.fma(a, b, c)

    number = types.float64
    return number(number, number, number), build


fused: Callable[[float, float, float], float] = cast(
    "Callable[[float, float, float], float]", intrinsic(_fused)
)
"""Gives a b + c with one rounding, in kernels: an instruction where the processor has it, else a function of
the C library that has the same bits."""
