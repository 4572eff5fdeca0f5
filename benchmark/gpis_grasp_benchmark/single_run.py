"""A run in a process of its own with one thread: ``python -m ...benchmark.single_run``.

Takes a pickled (run, part) on stdin and answers a JSON object with the record and the document
on stdout.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading

from gpis_grasp_benchmark.runs import Record, Task
from gpis_grasp_planner.errors import GraspPlannerError, SystemFault
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.thread_limits import THREAD_VARIABLES

_MODULE = "gpis_grasp_benchmark.single_run"
# Beyond the budget: imports, and compiling where nothing is compiled yet.
_GRACE_S = 300.0
_LAST_WORDS = 400


class RunProcesses:
    """Starts runs in processes of their own and can end them all."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._stopped = False

    def execute(self, run: Task, part: Part) -> tuple[Record, str]:
        """Make one run; blocks. Returns the record and the text of the document.

        Raises
        ------
        SystemFault
            If the process dies, hangs, or :meth:`stop` was called.
        """
        environment = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, "1")}
        with self._lock:
            if self._stopped:
                raise SystemFault("The benchmark was stopped.")
            process = subprocess.Popen(
                [sys.executable, "-m", _MODULE],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=environment,
                start_new_session=True,  # Ctrl-C reaches the parent, which ends its children
            )
            self._running.add(process)
        try:
            limit = run.longest_s + _GRACE_S
            out, err = process.communicate(pickle.dumps((run, part)), timeout=limit)
        except subprocess.TimeoutExpired:
            raise SystemFault(f"Run {run.name} did not end within {limit:g} s.") from None
        finally:
            process.kill()
            process.wait()
            with self._lock:
                self._running.discard(process)
        if process.returncode != 0:
            words = err.decode(errors="replace").strip()[-_LAST_WORDS:]
            raise SystemFault(f"Run {run.name} ended with code {process.returncode}: {words}")
        answer = json.loads(out)
        return answer["record"], answer["document"]

    def stop(self) -> None:
        """End all running processes and start no more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()


def main() -> int:
    """Read the run from stdin, make it, write the answer to stdout."""
    # What a library prints must not end up in the answer.
    answer = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    run, part = pickle.loads(sys.stdin.buffer.read())  # from RunProcesses, nobody else
    try:
        record, document = run.make(part)
    except GraspPlannerError as error:
        sys.stderr.write(str(error))
        return 1
    with answer:
        json.dump({"record": record, "document": document}, answer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
