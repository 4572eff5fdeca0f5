"""Ctrl-C once: stop with what was found. Twice: at once."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
from pathlib import Path

import pytest
from terminal_sessions import PROGRAM, environment

from gpis_grasp_planner.cli.interrupt import stop_on_interrupt


def test_the_first_asks_and_the_second_ends() -> None:
    said: list[str] = []
    before = signal.getsignal(signal.SIGINT)
    with stop_on_interrupt(said.append) as stopped:
        assert not stopped()
        os.kill(os.getpid(), signal.SIGINT)
        assert stopped()
        assert len(said) == 1
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_outside_the_main_thread_nothing_is_changed() -> None:
    handlers = []

    def run() -> None:
        with stop_on_interrupt(print) as stopped:
            handlers.append((signal.getsignal(signal.SIGINT), stopped()))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert handlers == [(signal.getsignal(signal.SIGINT), False)]


def test_an_interrupted_plan_prints_and_writes_what_it_found(tmp_path: Path) -> None:
    file = tmp_path / "grasps.json"
    words = ("plan", "sphere", "--time", "300", "--planner", "random-adaption", "--verify", "none")
    ours, theirs = os.openpty()  # progress says when there is a grasp to keep
    process = subprocess.Popen(
        [*PROGRAM, *words, "--json", str(file)],
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=environment(),
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    os.close(theirs)
    shown = b""
    while b"best epsilon" not in shown:
        shown += os.read(ours, 4096)
    process.send_signal(signal.SIGINT)
    reader = threading.Thread(target=lambda: [None for _ in iter(lambda: _read(ours), b"")])
    reader.start()
    out, _ = process.communicate(timeout=120)
    reader.join()
    os.close(ours)
    assert process.returncode == 130
    assert "epsilon" in out.splitlines()[0]
    document = json.loads(file.read_text())
    assert document["status"] == "CANCELLED"
    assert document["grasps"]


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 4096)
    except OSError:  # the other side is closed
        return b""
