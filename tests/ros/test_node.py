"""Starting the node: security that must not be missing, log files, exit codes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gpis_grasp_planner.ros.node import (
    EXIT_CONFIGURATION,
    insist_on_security,
    without_log_files,
)

LIMIT_S = 120.0
NO_FILES = ["--ros-args", "--disable-external-lib-logs"]


@pytest.mark.parametrize(
    ("enabled", "before", "after"),
    [
        ("true", None, "Enforce"),
        ("TRUE", "Permissive", "Enforce"),
        ("false", "Permissive", "Permissive"),
        ("", None, None),
        (None, None, None),
    ],
)
def test_where_security_is_asked_for_it_is_enforced(
    monkeypatch: pytest.MonkeyPatch, enabled: str | None, before: str | None, after: str | None
) -> None:
    # Set first, so that the fixture puts back what is there now whatever the function does.
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", before or "")
    if before is None:
        del os.environ["ROS_SECURITY_STRATEGY"]
    monkeypatch.setenv("ROS_SECURITY_ENABLE", enabled or "")
    if enabled is None:
        monkeypatch.delenv("ROS_SECURITY_ENABLE")
    insist_on_security()
    assert os.environ.get("ROS_SECURITY_STRATEGY") == after


@pytest.fixture
def folders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A home, and no other word about where logs go."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("ROS_HOME", raising=False)
    monkeypatch.delenv("ROS_LOG_DIR", raising=False)
    (tmp_path / "home").mkdir()
    (tmp_path / "file").write_text("no folder can be made below a file")
    return tmp_path


def test_log_files_stay_on_where_their_folder_can_be_made(folders: Path) -> None:
    assert without_log_files() == []
    assert list((folders / "home" / ".ros" / "log").iterdir()) == []


@pytest.mark.parametrize(
    ("variable", "folder"), [("ROS_HOME", "log"), ("ROS_LOG_DIR", ""), ("HOME", ".ros/log")]
)
def test_the_folder_is_the_one_that_rcl_takes(
    monkeypatch: pytest.MonkeyPatch, folders: Path, variable: str, folder: str
) -> None:
    monkeypatch.setenv(variable, str(folders / "other"))
    assert without_log_files() == []
    assert (folders / "other" / folder).is_dir()
    monkeypatch.setenv(variable, str(folders / "file"))
    assert without_log_files() == NO_FILES


def test_the_log_folder_goes_before_a_home_that_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, folders: Path
) -> None:
    monkeypatch.setenv("HOME", str(folders / "file"))
    monkeypatch.setenv("ROS_LOG_DIR", str(folders / "logs"))
    assert without_log_files() == []


def run(arguments: str, entry: str = "main") -> subprocess.CompletedProcess[str]:
    code = f"import sys; from gpis_grasp_planner.ros import node; sys.exit(node.{entry}())"
    command = [sys.executable, "-c", code, *arguments.split()]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("--ros-args -p queue_sise:=2", "queue_size"),
        ("--ros-args -p hand.model:=claw", "claw"),
        ("--ros-args -p", "Not started:"),
        ("--ros-args --no-such-option", "--no-such-option"),
    ],
)
def test_what_it_cannot_start_with_ends_in_one_line_and_code_2(arguments: str, says: str) -> None:
    ended = run(arguments)
    assert ended.returncode == EXIT_CONFIGURATION
    assert says in ended.stderr
    assert "Not started:" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    "error", ['RuntimeError("can\'t start new thread")', "OSError(24, 'Too many open files')"]
)
def test_limits_of_the_system_are_told_as_such(error: str) -> None:
    code = (
        "import sys; from gpis_grasp_planner.ros import node, worker; "
        "from gpis_grasp_planner.ros.worker import supervisor\n"
        f"def refuse(*_): raise {error}\n"
        "supervisor.WorkerLink = refuse; sys.exit(node.main())"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert ended.returncode == EXIT_CONFIGURATION
    assert "Not started: the system refuses" in ended.stderr
    assert "ulimit" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_the_lifecycle_node_starts_with_the_same_checks() -> None:
    ended = run("--ros-args -p queue_sise:=2", "main_lifecycle")
    assert ended.returncode == EXIT_CONFIGURATION
    assert "queue_size" in ended.stderr


def test_it_ends_though_a_thread_waits_for_a_disk_that_does_not_answer() -> None:
    code = (
        "import os, signal, sys, threading; from concurrent.futures import ThreadPoolExecutor; "
        "from gpis_grasp_planner.ros import node; node.LEAVE_S = 0.2; "
        "ThreadPoolExecutor(1).submit(threading.Event().wait); "
        "node.insist_on_security = lambda: os.kill(os.getpid(), signal.SIGTERM); "
        "sys.exit(node.main(['node']))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert ended.returncode == 0
    assert "Ended while a request still waited" in ended.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_the_imports_ends_it_in_order(number: int) -> None:
    code = (
        "import os, sys; from gpis_grasp_planner.ros import node; "
        "node.insist_on_security = lambda: os.kill(os.getpid(), int(sys.argv[1])); "
        "code = node.main(['node']); "
        "assert 'gpis_grasp_planner.ros.planner_node' in sys.modules; sys.exit(code)"
    )
    began = time.monotonic()
    ended = subprocess.run(
        [sys.executable, "-c", code, str(int(number))], capture_output=True, timeout=LIMIT_S
    )
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert time.monotonic() - began < LIMIT_S
