"""Compiled functions, kept on disk: ``@njit`` of this module in place of numba's own.

Numba's cache gives up a function, and with it the import of its module, where no folder can be
written; it ends a plan where the disk is full, and two processes that compile two signatures of one
function at a time can mix up their files. Here a file is named by all that its code depends on,
it is written under another name and moved, its checksum is looked at before it is used, and a
cache that cannot be read or written costs time, nothing else.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import event
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from gpis_grasp_planner.compiled_cache import contents, folders, write_kept

_log = logging.getLogger(__name__)
_CHECKSUM = 32


def njit(
    function: Callable[..., Any] | None = None, *, allocates: bool = True, **options: Any
) -> Any:
    """Decorate a function to be compiled without Python objects and without the GIL, and kept.

    Parameters
    ----------
    function : callable
        Of a module of this package.
    allocates : bool
        Whether it makes arrays. One that makes none counts no references to those that it is
        given: a tuple of forty arrays costs 0.4 us to enter and to leave otherwise. Numba refuses
        to compile an array that is made in it all the same.
    **options
        Of ``numba.njit``, such as ``inline="always"``.
    """
    if function is None:
        return functools.partial(njit, allocates=allocates, **options)
    options["_nrt"] = allocates  # said in either case: it would come from the caller otherwise
    dispatcher = numba.njit(nogil=True, **options)(function)
    dispatcher._cache = FunctionFiles(function)
    return dispatcher


def is_ready(task: str) -> bool:
    """Whether all that a task needs has been compiled for this machine, see :func:`mark_ready`."""
    return any(content == _machine() for content in contents(f"ready-{task}"))


def mark_ready(task: str) -> None:
    """Note that all that a task needs lies on disk, unless this process could not keep it."""
    if not FunctionFiles._said:
        write_kept(f"ready-{task}", _machine())


@contextmanager
def when_compiling(say: Callable[[], None]) -> Iterator[None]:
    """Call `say` once, when the first function is compiled that does not lie on disk.

    A slow machine that loads compiled code compiles nothing, and hears nothing.
    """

    class FirstCompilation(event.Listener):
        said = False

        def on_start(self, event: Any) -> None:  # noqa: ARG002
            if not self.said:
                self.said = True
                say()

        def on_end(self, event: Any) -> None:
            """Nothing to do."""

    with event.install_listener("numba:compile", FirstCompilation()):
        yield


class FunctionFiles(_Cache):
    """The files of one function, one a signature and machine; numba asks and fills it.

    Parameters
    ----------
    function : callable
        Of a module of this package.
    """

    _said = False

    def __init__(self, function: Callable[..., Any]):
        code = function.__code__
        self._function = (code.co_filename, function.__qualname__, code.co_firstlineno)
        self._code = hashlib.sha256(code.co_code).hexdigest()
        module = function.__module__.rpartition(".")[2]
        self._name = f"{module}.{function.__qualname__}"

    @property
    def cache_path(self) -> str:
        """Where numba says that the code lies."""
        return str(folders()[0])

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code of a signature, or None."""
        target_context.refresh()
        key = self._key(sig)
        for content in contents(self._file(key)):
            checksum, body = content[:_CHECKSUM], content[_CHECKSUM:]
            if hashlib.sha256(body).digest() != checksum:
                continue
            kept, payload = pickle.loads(body)
            if kept == key:
                return CompileResult._rebuild(target_context, *pickle.loads(payload))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code, where that is possible."""
        if any(not lifted.can_cache for lifted in data.lifted) or data.library.has_dynamic_globals:
            return
        key = self._key(sig)
        body = pickle.dumps((key, dumps(data._reduce())))
        error = write_kept(self._file(key), hashlib.sha256(body).digest() + body)
        if error is not None and not FunctionFiles._said:
            FunctionFiles._said = True
            _log.warning(
                "Compiled code cannot be kept (%s): every start compiles anew, for about a minute. "
                "Make one of these writable: %s.",
                error,
                ", ".join(str(folder) for folder in folders()),
            )

    def enable(self) -> None:
        """Nothing to do: always on."""

    def disable(self) -> None:
        """Nothing to do: always on."""

    def flush(self) -> None:
        """Forget nothing: files of an earlier state lie in another folder."""

    def _key(self, sig: Any) -> tuple[str, bytes, str]:
        return repr(sig), _machine(), self._code

    def _file(self, key: tuple[str, bytes, str]) -> str:
        digest = hashlib.sha256(repr((self._function[2], key)).encode()).hexdigest()
        return f"{self._name}.{digest[:16]}"


def _machine() -> bytes:
    """Everything outside the sources that compiled code depends on."""
    magic = cpu_target.target_context.codegen().magic_tuple()
    return repr((numba.__version__, sys.version_info[:2], magic)).encode()
