"""A machine on which things are missing is told what, and left alone."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/system_packages.sh"


@pytest.fixture
def bare_path(tmp_path: Path) -> Path:
    """A directory of programs with little more than a shell in it."""
    for tool in ("bash", "env", "id", "sed"):
        (tmp_path / tool).symlink_to(shutil.which(tool) or tool)
    return tmp_path


def run(path: str | Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the script with the programs of one directory only."""
    bash = shutil.which("bash") or "bash"
    return subprocess.run(
        [bash, str(SCRIPT), *options], capture_output=True, text=True, env={"PATH": str(path)}
    )


def test_a_bare_machine_is_told_what_to_install(bare_path: Path) -> None:
    answer = run(bare_path)
    assert answer.returncode == 2
    for package in ("python3.11-venv", "libpython3.11-dev", "cmake", "g++", "libegl1"):
        assert f" {package}" in answer.stderr
    assert "no Debian-like system" in answer.stderr


def test_check_installs_nothing(bare_path: Path) -> None:
    for name in ("apt-get", "sudo"):
        tool = bare_path / name
        tool.write_text(f"#!{bare_path}/bash\necho called > {bare_path}/called\n")
        tool.chmod(0o755)
    answer = run(bare_path, "--check")
    assert answer.returncode == 2
    assert not (bare_path / "called").exists()


def test_a_browser_is_asked_for_by_the_tests_alone(bare_path: Path) -> None:
    assert "chromium" not in run(bare_path).stderr
    answer = run(bare_path, "--browser")
    assert answer.returncode == 2
    assert " chromium" in answer.stderr
    (bare_path / "chromium").symlink_to(shutil.which("true") or "true")
    assert run(bare_path, "--browser").returncode == 0


def test_another_python_does_not_count(bare_path: Path) -> None:
    """A python3 that is not CPython 3.11 is passed over."""
    other = bare_path / "python3"
    other.write_text(f"#!{bare_path}/bash\nexit 1\n")
    other.chmod(0o755)
    answer = run(bare_path, "--python")
    assert answer.returncode == 1
    assert answer.stdout == ""


def test_this_machine_has_everything() -> None:
    answer = run(os.environ["PATH"], "--check")
    assert answer.returncode == 0, answer.stderr
